#include "server/commands/commands.h"

namespace valvetriage {

void add_paper_command(CLI::App& app, int& exit_status) {
  CLI::App* verb =
      app.add_subcommand("paper", "The published equations and tables, recomputed, with what does not hold");
  verb->callback([&exit_status] { exit_status = kDone; });
}

}  // namespace valvetriage
