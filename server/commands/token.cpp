#include <fmt/format.h>

#include <memory>

#include "server/commands/commands.h"
#include "server/commands/data_options.h"
#include "server/commands/server_options.h"
#include "server/http/access.h"
#include "server/http/request_head.h"
#include "server/http/serve.h"
#include "server/store/sqlite/sqlite_store.h"
#include "server/wire/json_fields.h"

namespace valvetriage {
namespace {

struct TokenArguments {
  DataOptions data;
  ServerOptions server;
  std::string name;
  std::string scopes = "submit,read";
  std::string id;
};

/// A token as it is shown, and its secret where it was just made.
struct ShownToken {
  std::string id, name, scopes, created_at;
  std::optional<std::string> revoked_at, secret;
};

ShownToken shown(const TokenRow& row) {
  ShownToken token{.id = row.id,
                   .name = row.name,
                   .scopes = fmt::format("{}", fmt::join(row.scopes, ",")),
                   .created_at = format_rfc3339(row.created_at)};
  if (row.revoked_at) token.revoked_at = format_rfc3339(*row.revoked_at);
  return token;
}

ShownToken shown(JsonFields fields) {
  return {.id = fields.text("id"),
          .name = fields.text("name"),
          .scopes = fmt::format("{}", fmt::join(fields.texts("scopes"), ",")),
          .created_at = fields.text("created_at"),
          .revoked_at = fields.optional_text("revoked_at"),
          .secret = fields.has("secret") ? fields.optional_text("secret") : std::nullopt};
}

Result<std::unique_ptr<Store>> open_store(const TokenArguments& arguments) {
  const auto file = arguments.data.database_file();
  if (!file) return tl::unexpected(file.error());
  if (auto made = http::make_folder(arguments.data.data_dir); !made) return tl::unexpected(made.error());
  return open_sqlite_store(*file);
}

/// The document of a successful answer; its problem otherwise.
Result<Json> accepted(const Result<http::Answer>& answer) {
  if (!answer) return tl::unexpected(answer.error());
  if (answer->status == 204) return Json();
  auto document = parse_json(answer->body);
  if (!document || !document->is_object())
    return fail("bad_answer", fmt::format("the server answered {}", answer->status));
  if (answer->status < 300) return document;
  return fail(document->value("code", "bad_answer"), document->value("detail", ""));
}

Result<ShownToken> create_at_server(const TokenArguments& arguments, const std::vector<std::string>& scopes) {
  auto client = open_client(arguments.server);
  if (!client) return tl::unexpected(client.error());
  const Json asked{{"name", arguments.name}, {"scopes", scopes}};
  const auto document = accepted(client->post("/v1/tokens", dump_json(asked)));
  if (!document) return tl::unexpected(document.error());
  std::optional<Error> error;
  ShownToken token = shown(JsonFields(*document, "", error));
  if (error) return tl::unexpected(*error);
  return token;
}

Result<ShownToken> create_in_store(const TokenArguments& arguments, const std::vector<std::string>& scopes) {
  const auto store = open_store(arguments);
  if (!store) return tl::unexpected(store.error());
  const std::string secret = http::new_token_secret();
  const auto row =
      (*store)->add_token({.name = arguments.name, .secret_sha256 = http::token_sha256(secret), .scopes = scopes});
  if (!row) return tl::unexpected(row.error());
  ShownToken token = shown(*row);
  token.secret = secret;
  return token;
}

/// The secret goes to standard output, once and alone, so that a script can keep it.
Result<void> create(const TokenArguments& arguments) {
  const auto scopes = http::parse_scopes(arguments.scopes);
  if (!scopes) return tl::unexpected(scopes.error());
  const auto token =
      arguments.server.url.empty() ? create_in_store(arguments, *scopes) : create_at_server(arguments, *scopes);
  if (!token) return tl::unexpected(token.error());
  fmt::print("{}\n", token->secret.value_or(""));
  fmt::print(stderr, "token {} '{}' with {}; it is shown this once and not stored\n", token->id, token->name,
             token->scopes);
  return {};
}

Result<std::vector<ShownToken>> tokens_of_server(const TokenArguments& arguments) {
  auto client = open_client(arguments.server);
  if (!client) return tl::unexpected(client.error());
  const auto document = accepted(client->get("/v1/tokens"));
  if (!document) return tl::unexpected(document.error());
  std::optional<Error> error;
  std::vector<ShownToken> tokens;
  for (const JsonFields& item : JsonFields(*document, "", error).objects("items")) tokens.push_back(shown(item));
  if (error) return tl::unexpected(*error);
  return tokens;
}

Result<std::vector<ShownToken>> tokens_of_store(const TokenArguments& arguments) {
  const auto store = open_store(arguments);
  if (!store) return tl::unexpected(store.error());
  const auto rows = (*store)->list_tokens();
  if (!rows) return tl::unexpected(rows.error());
  std::vector<ShownToken> tokens;
  for (const TokenRow& row : *rows) tokens.push_back(shown(row));
  return tokens;
}

Result<void> list(const TokenArguments& arguments) {
  const auto tokens = arguments.server.url.empty() ? tokens_of_store(arguments) : tokens_of_server(arguments);
  if (!tokens) return tl::unexpected(tokens.error());
  for (const ShownToken& token : *tokens) {
    fmt::print("{}\t{}\t{}\t{}\t{}\n", token.id, token.name, token.scopes, token.created_at,
               token.revoked_at ? "revoked " + *token.revoked_at : "valid");
  }
  return {};
}

Result<void> revoke(const TokenArguments& arguments) {
  if (arguments.server.url.empty()) {
    const auto store = open_store(arguments);
    if (!store) return tl::unexpected(store.error());
    return (*store)->revoke_token(arguments.id, "local");
  }
  auto client = open_client(arguments.server);
  if (!client) return tl::unexpected(client.error());
  const auto done = accepted(client->remove("/v1/tokens/" + http::percent_encode(arguments.id)));
  if (!done) return tl::unexpected(done.error());
  return {};
}

ExitStatus status_of(const Result<void>& done) {
  if (done) return kDone;
  print_error(done.error());
  return done.error().code == "bad_parameter" || done.error().code == "not_found" ? kBadInput : kFailure;
}

}  // namespace

void add_token_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("token",
                                      "Access tokens: of a running server with --server, else of its database, which "
                                      "no server may have open then");
  const auto arguments = std::make_shared<TokenArguments>();
  verb->require_subcommand(1);
  add_data_options(*verb, arguments->data);
  add_server_options(*verb, arguments->server);
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
