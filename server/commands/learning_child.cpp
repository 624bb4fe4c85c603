#include "server/jobs/learning_child.h"

#include "server/commands/commands.h"
#include "server/jobs/analysis_job.h"

namespace valvetriage {

void add_learning_child_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand(std::string(kLearningVerb), "Learn one reference for the server");
  verb->group("");  // not for people: the server starts it
  verb->callback([&exit_status] {
    keep_freed_memory();
    exit_status = run_learning_child();
  });
}

}  // namespace valvetriage
