#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "server/http/exchange.h"
#include "server/http/service.h"

namespace valvetriage::http {

/// What a token must be allowed to do. `admin` may everything, `submit` and `read` only what they say.
enum class Scope { kPublic, kRead, kSubmit, kAdmin };

std::string_view to_text(Scope scope);

using RouteHandler = Result<Response> (*)(Service&, Request&);

/// One route. The table is the one source of what exists: access rights, 404 and 405, and the tests of both derive from
/// it; schemas/openapi.yaml is checked against it.
///
/// pattern     `{name}` stands for one segment of the path
/// parameters  names of the query parameters, separated by blanks; others are refused
struct Route {
  std::string_view method;
  std::string_view pattern;
  Scope scope;
  std::string_view parameters;
  RouteHandler handler;
};

std::span<const Route> routes();

/// Whether a path fits a pattern; its segments at `{}` are appended to `captures`.
bool matches(std::string_view pattern, std::span<const std::string> path, std::vector<std::string>& captures);

/// Finds the route, checks site, token, scope and parameters, and calls the handler. HEAD is a GET without its body;
/// OPTIONS tells the methods.
Response dispatch(Service& service, Request& request);

}  // namespace valvetriage::http
