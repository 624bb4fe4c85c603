#include "server/http/serve.h"

#include <fmt/format.h>

#include <sys/stat.h>

#include <cstdio>
#include <memory>

#include "server/commands/commands.h"
#include "server/commands/data_options.h"
#include "server/commands/rule_base.h"
#include "server/wire/rule_base_json.h"

namespace valvetriage {
namespace {

struct ServeArguments {
  DataOptions data;
  http::ServeOptions options;
  std::string rule_base;
};

Result<void> run(const ServeArguments& arguments) {
  ::umask(0027);  // what others sent is not for everyone on this machine
  http::ServeOptions options = arguments.options;
  const auto database_file = arguments.data.database_file();
  if (!database_file) return tl::unexpected(database_file.error());
  options.database_file = *database_file;
  options.data_dir = arguments.data.data_dir;
  if (!arguments.rule_base.empty()) {
    const auto rule_base = open_rule_base(arguments.rule_base);
    if (!rule_base) return tl::unexpected(rule_base.error());
    options.rule_base_json = dump_json(to_json(*rule_base));
  }
  return http::serve(options, [](const http::Endpoint& endpoint) {
    fmt::print("listening on {}\n", endpoint.url());
    std::fflush(stdout);
  });
}

/// What the machine or the state of the data keeps from starting; everything else is in the caller's hands.
ExitStatus status_of(const Error& error) {
  for (const char* code : {"address_in_use", "cannot_listen", "store_locked", "store_mismatch", "store_broken",
                           "no_space", "io_error", "cannot_make_folder"}) {
    if (error.code == code) return kFailure;
  }
  return kBadInput;
}

}  // namespace

void add_serve_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("serve", "Take recordings in over HTTP, analyse them, answer for them");
  const auto arguments = std::make_shared<ServeArguments>();
  http::ServeOptions& options = arguments->options;
  verb->add_option("--listen", options.listen, "HOST:PORT or unix:PATH; port 0 lets the system choose")
      ->capture_default_str();
  add_data_options(*verb, arguments->data);
  verb->add_option("--workers", options.workers, "Analyses at a time; 0 only accepts and stores")
      ->check(CLI::Range(0, 256))
      ->capture_default_str();
  verb->add_option("--rule-base", arguments->rule_base, "File, paper or calibrated: for valve types that have none");
  verb->add_flag("--require-token", options.require_token, "Ask for a token on a local address too");
  verb->add_flag("--behind-proxy", options.behind_proxy, "A proxy with TLS passes requests on: tokens are required");
  verb->callback([arguments, &exit_status] {
    const auto served = run(*arguments);
    if (served) return;
    print_error(served.error());
    exit_status = status_of(served.error());
  });
}

}  // namespace valvetriage
