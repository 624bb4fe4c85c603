#include "server/commands/commands.h"

int main(int argc, char** argv) {
  using namespace valvetriage;
  CLI::App app{"valvetriage: batch analysis of warranty returns of electronic fuel-control valves"};
  app.set_version_flag("--version", "valvetriage " VALVETRIAGE_VERSION);
  app.require_subcommand(1);
  int exit_status = kDone;
#define X(verb) add_##verb##_command(app, exit_status);
  VALVETRIAGE_COMMANDS(X)
#undef X
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kDone : kBadInput;
  }
  return exit_status;
}
