#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <exception>

#include "server/commands/commands.h"

namespace valvetriage {
namespace {

/// The first word of the call where it is neither an option nor a verb.
bool is_wrong_verb(const CLI::App& app, const std::string& word) {
  const auto verbs = app.get_subcommands([](const CLI::App*) { return true; });
  return !word.starts_with('-') &&
         std::none_of(verbs.begin(), verbs.end(), [&](const CLI::App* verb) { return verb->get_name() == word; });
}

}  // namespace
}  // namespace valvetriage

int main(int argc, char** argv) {
  using namespace valvetriage;
  CLI::App app{"valvetriage: batch analysis of warranty returns of electronic fuel-control valves"};
  app.set_version_flag("--version", "valvetriage " VALVETRIAGE_VERSION);
  app.require_subcommand(1);
  app.footer(
      "Exit status: 0 done, 1 failure, 2 bad input or usage. submit --wait: 1 the server or a job failed, else 2 some\n"
      "input was rejected, else 3 some verdict is not Good or there is none.");
  int exit_status = kDone;
#define X(verb) add_##verb##_command(app, exit_status);
  VALVETRIAGE_COMMANDS(X)
#undef X
  if (argc > 1 && is_wrong_verb(app, argv[1])) {
    print_error({.code = "unknown_verb", .message = fmt::format("'{}' is no verb; --help lists them", argv[1])});
    return kBadInput;
  }
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? kDone : kBadInput;
  } catch (const std::exception& error) {
    print_error({.code = "internal", .message = error.what()});
    return kFailure;
  }
  // What could not be written, on a full disk, was not done.
  if (exit_status != kFailure && (std::fflush(stdout) != 0 || std::ferror(stdout) != 0)) {
    print_error({.code = "cannot_write", .message = "standard output cannot be written"});
    return kFailure;
  }
  return exit_status;
}
