#include "server/http/access.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sodium/randombytes.h>
#include <sodium/utils.h>
#include <strings.h>

#include <algorithm>
#include <array>

#include "core/recording/text.h"
#include "server/wire/sha256.h"

namespace valvetriage::http {
namespace {

constexpr std::size_t kSecretBytes = 32;
constexpr std::string_view kBearer = "bearer ";

bool contains(const std::vector<std::string>& scopes, std::string_view scope) {
  return std::find(scopes.begin(), scopes.end(), scope) != scopes.end();
}

/// Host without its port: more than one colon outside of brackets is an IPv6 address alone.
std::string_view host_name(std::string_view authority) {
  if (authority.starts_with('[')) return authority.substr(0, std::min(authority.find(']'), authority.size() - 1) + 1);
  const auto colon = authority.find(':');
  return authority.rfind(':') == colon ? authority.substr(0, colon) : authority;
}

/// A number of 127.0.0.0/8, ::1 or localhost: "127.evil.example" is a name like any other.
bool is_this_machine(std::string_view host) {
  if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
  const std::string name(host);
  if (strcasecmp(name.c_str(), "localhost") == 0) return true;
  in_addr four{};
  if (inet_pton(AF_INET, name.c_str(), &four) == 1) return (ntohl(four.s_addr) >> 24) == 127;
  in6_addr six{};
  return inet_pton(AF_INET6, name.c_str(), &six) == 1 && IN6_IS_ADDR_LOOPBACK(&six);
}

}  // namespace

std::string new_token_secret() {
  std::array<unsigned char, kSecretBytes> bits{};
  randombytes_buf(bits.data(), bits.size());
  std::array<char, sodium_base64_ENCODED_LEN(kSecretBytes, sodium_base64_VARIANT_URLSAFE_NO_PADDING)> text{};
  sodium_bin2base64(text.data(), text.size(), bits.data(), bits.size(), sodium_base64_VARIANT_URLSAFE_NO_PADDING);
  return std::string("vt_") + text.data();
}

std::string token_sha256(const std::string& secret) {
  return sha256_hex(secret);
}

Result<std::vector<std::string>> parse_scopes(const std::string& text) {
  std::vector<std::string> scopes;
  for (std::size_t at = 0; at <= text.size();) {
    const auto comma = std::min(text.find(',', at), text.size());
    const std::string scope(trim(std::string_view(text).substr(at, comma - at)));
    if (scope != "read" && scope != "submit" && scope != "admin") {
      return fail("bad_parameter", fmt::format("'{}' is no scope; scopes are read, submit and admin", scope));
    }
    if (!contains(scopes, scope)) scopes.push_back(scope);
    at = comma + 1;
  }
  return scopes;
}

Result<void> authorize(Service& service, Scope scope, Request& request) {
  const auto header = request.head.header("authorization");
  if (scope == Scope::kPublic) return {};
  if (!header && !service.tokens_required) {
    request.actor = "local";
    return {};
  }
  if (!header) {
    return fail("token_missing",
                "this server needs a token: send 'Authorization: Bearer ...' (made by 'valvetriage token create')");
  }
  if (!to_lower_ascii(*header).starts_with(kBearer)) {
    return fail("token_unknown", "the Authorization header is not 'Bearer' and a token");
  }
  const auto token = service.store.token_by_secret(token_sha256(std::string(trim(header->substr(kBearer.size())))));
  if (!token && token.error().code != "not_found") return tl::unexpected(token.error());
  if (!token) return fail("token_unknown", "the token is unknown or revoked");
  request.actor = token->id;
  if (contains(token->scopes, "admin") || contains(token->scopes, to_text(scope))) return {};
  return fail("scope_missing", fmt::format("the token lacks the scope '{}'", to_text(scope)));
}

Result<void> check_site(const Service& service, const RequestHead& head) {
  const std::string_view host = *head.header("host");
  const auto origin = head.header("origin");
  if (origin && *origin != fmt::format("http://{}", host) && *origin != fmt::format("https://{}", host)) {
    return fail("cross_site", "requests from pages of other sites are not accepted");
  }
  const auto site = head.header("sec-fetch-site");
  if (site && *site == "cross-site" && head.method != "GET" && head.method != "HEAD") {
    return fail("cross_site", "requests from pages of other sites are not accepted");
  }
  if (service.check_host && !service.tokens_required && !is_this_machine(host_name(host))) {
    return fail("host_not_allowed", fmt::format("this server answers to localhost only, not to '{}'", shown(host)));
  }
  return {};
}

}  // namespace valvetriage::http
