#include <fmt/format.h>

#include "server/http/access.h"
#include "server/http/handlers.h"
#include "server/http/receive.h"
#include "server/http/views.h"
#include "server/wire/json_fields.h"

namespace valvetriage::http {
namespace {

constexpr std::size_t kMaxTokenRequestBytes = 4 * 1024;
constexpr std::size_t kMaxTokenNameBytes = 200;

Result<NewToken> token_of(const Json& document, const Request& request) {
  std::optional<Error> error;
  JsonFields fields(document, "", error);
  NewToken token{.name = fields.text("name"), .secret_sha256 = {}, .scopes = {}, .actor = request.actor};
  const auto named = fields.texts("scopes");
  if (token.name.size() > kMaxTokenNameBytes) {
    fields.refuse("name", "too_long", fmt::format("is longer than {} bytes", kMaxTokenNameBytes));
  }
  if (error) return tl::unexpected(*error);
  auto scopes = parse_scopes(fmt::format("{}", fmt::join(named, ",")));
  if (!scopes) return tl::unexpected(scopes.error());
  token.scopes = std::move(*scopes);
  return token;
}

}  // namespace

Result<Response> list_tokens(Service& service, Request& request) {
  const auto rows = service.store.list_tokens();
  if (!rows) return tl::unexpected(rows.error());
  std::vector<Json> items;
  for (const TokenRow& row : *rows) items.push_back(view(row));
  return whole_list_response(request, std::move(items));
}

Result<Response> post_token(Service& service, Request& request) {
  const auto document = receive_json(request, kMaxTokenRequestBytes);
  if (!document) return tl::unexpected(document.error());
  auto token = token_of(*document, request);
  if (!token) return tl::unexpected(token.error());
  const std::string secret = new_token_secret();
  token->secret_sha256 = token_sha256(secret);
  const auto row = service.store.add_token(*token);
  if (!row) return tl::unexpected(row.error());
  Json made = view(*row);
  made["secret"] = secret;
  Response response = json_response(made, 201);
  response.set_header("Cache-Control", "no-store");
  return response;
}

Result<Response> delete_token(Service& service, Request& request) {
  if (auto revoked = service.store.revoke_token(request.captures[0], request.actor); !revoked) {
    return tl::unexpected(revoked.error());
  }
  Response response;
  response.status = 204;
  return response;
}

}  // namespace valvetriage::http
