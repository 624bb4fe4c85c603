#pragma once

#include <string>
#include <vector>

#include "core/result.h"
#include "server/http/exchange.h"
#include "server/http/routes.h"
#include "server/http/service.h"

namespace valvetriage::http {

/// A new secret: "vt_" and 256 random bits in base64url. Shown once, never stored.
std::string new_token_secret();

/// What is stored of it.
std::string token_sha256(const std::string& secret);

/// "submit,read" -> {"submit", "read"}. Errors `bad_parameter`.
Result<std::vector<std::string>> parse_scopes(const std::string& text);

/// Checks the bearer token against the scope and sets `request.actor`. The secret is only ever compared as its SHA-256,
/// by an index over hashes, so that time tells nothing about it.
///
/// Errors  `token_missing`, `token_unknown`, `scope_missing`; the store's
Result<void> authorize(Service& service, Scope scope, Request& request);

/// Keeps web pages of other sites away from a server that trusts whoever reaches it: Origin and Sec-Fetch-Site must be
/// this site, and on a local server without tokens Host must be a name of this machine.
///
/// Errors  `cross_site`, `host_not_allowed`
Result<void> check_site(const Service& service, const RequestHead& head);

}  // namespace valvetriage::http
