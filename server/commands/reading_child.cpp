#include "server/jobs/reading_child.h"

#include "server/commands/commands.h"

namespace valvetriage {

void add_reading_child_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand(std::string(kReadingVerb), "Read one file for the server");
  verb->group("");  // not for people: the server starts it
  verb->callback([&exit_status] { exit_status = run_reading_child(); });
}

}  // namespace valvetriage
