#include <algorithm>

#include "server/http/assets.h"
#include "server/http/handlers.h"
#include "server/http/problem.h"
#include "server/http/views.h"

namespace valvetriage::http {
namespace {

/// Nothing but the page's own files and its own server.
constexpr const char* kContentSecurityPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self' data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

Response page_response(const Asset& asset) {
  Response response;
  response.content_type = asset.content_type;
  response.body = asset.content;
  response.set_header("Content-Security-Policy", kContentSecurityPolicy);
  response.set_header("Referrer-Policy", "no-referrer");
  response.set_header("Cache-Control", "no-cache");
  return response;
}

}  // namespace

Result<Response> get_metrics(Service& service, Request&) {
  const auto queue = service.store.queue_stats();
  if (!queue) return tl::unexpected(queue.error());
  Response response;
  response.content_type = "text/plain; version=0.0.4; charset=utf-8";
  response.body = service.metrics.text(*queue, system_clock().utc_ms());
  return response;
}

Result<Response> get_openapi(Service&, Request&) {
  Response response;
  response.body = find_asset("openapi.json")->content;
  return response;
}

Result<Response> get_healthz(Service&, Request&) {
  return json_response(Json{{"status", "ok"}, {"version", VALVETRIAGE_VERSION}});
}

Result<Response> get_readyz(Service& service, Request&) {
  if (service.stopping()) return fail("draining", "the server is shutting down");
  if (auto probed = service.store.probe(); !probed) return tl::unexpected(probed.error());
  if (auto room = admit(service.store, service.blobs, service.limits); !room) return tl::unexpected(room.error());
  return json_response(Json{{"status", "ready"}});
}

Result<Response> get_page(Service&, Request&) {
  return page_response(*find_asset("index.html"));
}

Result<Response> get_page_file(Service&, Request& request) {
  const Asset* asset = find_asset(request.captures[0]);
  if (!asset) return fail("not_found", "the page has no such file");
  return page_response(*asset);
}

}  // namespace valvetriage::http
