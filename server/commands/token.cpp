#include <fmt/format.h>

#include <memory>

#include "server/commands/commands.h"
#include "server/commands/data_options.h"
#include "server/http/access.h"
#include "server/http/serve.h"
#include "server/store/sqlite/sqlite_store.h"

namespace valvetriage {
namespace {

struct TokenArguments {
  DataOptions data;
  std::string name;
  std::string scopes = "submit,read";
  std::string id;
};

Result<std::unique_ptr<Store>> open_store(const TokenArguments& arguments) {
  const auto file = arguments.data.database_file();
  if (!file) return tl::unexpected(file.error());
  if (auto made = http::make_folder(arguments.data.data_dir); !made) return tl::unexpected(made.error());
  return open_sqlite_store(*file);
}

/// The secret goes to standard output, once and alone, so that a script can keep it.
Result<void> create(const TokenArguments& arguments) {
  auto scopes = http::parse_scopes(arguments.scopes);
  if (!scopes) return tl::unexpected(scopes.error());
  const auto store = open_store(arguments);
  if (!store) return tl::unexpected(store.error());
  const std::string secret = http::new_token_secret();
  const auto row = (*store)->add_token(
      {.name = arguments.name, .secret_sha256 = http::token_sha256(secret), .scopes = std::move(*scopes)});
  if (!row) return tl::unexpected(row.error());
  fmt::print("{}\n", secret);
  fmt::print(stderr, "token {} '{}' with {}; it is shown this once and not stored\n", row->id, row->name,
             fmt::join(row->scopes, ","));
  return {};
}

Result<void> list(const TokenArguments& arguments) {
  const auto store = open_store(arguments);
  if (!store) return tl::unexpected(store.error());
  const auto rows = (*store)->list_tokens();
  if (!rows) return tl::unexpected(rows.error());
  for (const TokenRow& row : *rows) {
    fmt::print("{}\t{}\t{}\t{}\t{}\n", row.id, row.name, fmt::join(row.scopes, ","), format_rfc3339(row.created_at),
               row.revoked_at ? "revoked " + format_rfc3339(*row.revoked_at) : "valid");
  }
  return {};
}

Result<void> revoke(const TokenArguments& arguments) {
  const auto store = open_store(arguments);
  if (!store) return tl::unexpected(store.error());
  return (*store)->revoke_token(arguments.id, "local");
}

ExitStatus status_of(const Result<void>& done) {
  if (done) return kDone;
  print_error(done.error());
  return done.error().code == "bad_parameter" || done.error().code == "not_found" ? kBadInput : kFailure;
}

}  // namespace

void add_token_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("token", "Access tokens of a server's database");
  const auto arguments = std::make_shared<TokenArguments>();
  verb->require_subcommand(1);
  add_data_options(*verb, arguments->data);
  verb->fallthrough();

  CLI::App* to_create = verb->add_subcommand("create", "Make a token; its secret is printed once");
  to_create->add_option("name", arguments->name, "Whose or what for")->required();
  to_create->add_option("--scopes", arguments->scopes, "Some of submit,read,admin")->capture_default_str();
  to_create->callback([arguments, &exit_status] { exit_status = status_of(create(*arguments)); });

  CLI::App* to_list = verb->add_subcommand("list", "Show all tokens, without secrets");
  to_list->callback([arguments, &exit_status] { exit_status = status_of(list(*arguments)); });

  CLI::App* to_revoke = verb->add_subcommand("revoke", "Make a token worthless at once");
  to_revoke->add_option("id", arguments->id, "The token's id")->required();
  to_revoke->callback([arguments, &exit_status] { exit_status = status_of(revoke(*arguments)); });
}

}  // namespace valvetriage
