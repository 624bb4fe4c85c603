#include "server/commands/commands.h"
#include "server/jobs/analysis_job.h"

namespace valvetriage {

void add_analysis_child_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand(std::string(kChildVerb), "Run one analysis job of the server");
  verb->group("");  // not for people: the server starts it
  verb->callback([&exit_status] {
    keep_freed_memory();
    exit_status = run_child(run_analysis_job);
  });
}

}  // namespace valvetriage
