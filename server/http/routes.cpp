#include "server/http/routes.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>

#include "server/http/access.h"
#include "server/http/handlers.h"
#include "server/http/log.h"
#include "server/http/problem.h"

namespace valvetriage::http {
namespace {

constexpr std::string_view kUploadParameters =
    "name serial lot valve_type condition test stand columns sample_rate_hz side";
constexpr std::string_view kSubmissionParameters =
    "serial lot valve_type condition test stand columns sample_rate_hz side";
constexpr std::string_view kReadingParameters = "columns sample_rate_hz side";
constexpr std::string_view kListParameters =
    "lot serial valve_type stand verdict cause since until limit cursor format";
constexpr std::string_view kPageParameters = "limit cursor format";
constexpr std::string_view kSeriesParameters = "what from to points recording format";

constexpr std::array kRoutes{
    Route{"POST", "/v1/recordings", Scope::kSubmit, kUploadParameters, post_recording},
    Route{"GET", "/v1/recordings", Scope::kRead, kListParameters, list_recordings},
    Route{"GET", "/v1/recordings/{id}", Scope::kRead, "", get_recording},
    Route{"GET", "/v1/recordings/{id}/raw", Scope::kRead, "", get_recording_raw},
    Route{"GET", "/v1/recordings/{id}/analysis", Scope::kRead, "", get_analysis},
    Route{"GET", "/v1/recordings/{id}/analyses", Scope::kRead, kPageParameters, list_analyses},
    Route{"GET", "/v1/recordings/{id}/summary", Scope::kRead, "", get_summary},
    Route{"GET", "/v1/recordings/{id}/series", Scope::kRead, kSeriesParameters, get_series},
    Route{"GET", "/v1/recordings/{id}/marks", Scope::kRead, "", get_marks},
    Route{"GET", "/v1/recordings/{id}/report", Scope::kRead, "", get_report},
    Route{"GET", "/v1/recordings/{id}/plot.svg", Scope::kRead, "", get_plot},
    Route{"POST", "/v1/recordings/{id}/reanalyze", Scope::kSubmit, kReadingParameters, post_reanalyze},
    Route{"POST", "/v1/submissions", Scope::kSubmit, kSubmissionParameters, post_submission},
    Route{"GET", "/v1/submissions", Scope::kRead, kListParameters, list_submissions},
    Route{"GET", "/v1/submissions/{id}", Scope::kRead, "", get_submission},
    Route{"GET", "/v1/submissions/{id}/raw", Scope::kRead, "recording", get_submission_raw},
    Route{"GET", "/v1/submissions/{id}/analysis", Scope::kRead, "", get_analysis},
    Route{"GET", "/v1/submissions/{id}/analyses", Scope::kRead, kPageParameters, list_analyses},
    Route{"GET", "/v1/submissions/{id}/summary", Scope::kRead, "", get_summary},
    Route{"GET", "/v1/submissions/{id}/series", Scope::kRead, kSeriesParameters, get_series},
    Route{"GET", "/v1/submissions/{id}/marks", Scope::kRead, "recording", get_marks},
    Route{"GET", "/v1/submissions/{id}/report", Scope::kRead, "", get_report},
    Route{"GET", "/v1/submissions/{id}/plot.svg", Scope::kRead, "recording", get_plot},
    Route{"POST", "/v1/submissions/{id}/reanalyze", Scope::kSubmit, kReadingParameters, post_reanalyze},
    Route{"GET", "/v1/analyses/{id}", Scope::kRead, "", get_stored_analysis},
    Route{"GET", "/v1/causes", Scope::kRead, kPageParameters, list_causes},
    Route{"GET", "/v1/lots", Scope::kRead, kPageParameters, list_lots},
    Route{"GET", "/v1/lots/{lot}", Scope::kRead, "", get_lot},
    Route{"GET", "/v1/lots/{lot}/history", Scope::kRead, "", get_lot_history},
    Route{"GET", "/v1/lots/{lot}/parameters", Scope::kRead, "", get_lot_parameters},
    Route{"GET", "/v1/lots/{lot}/shifts", Scope::kRead, "", get_lot_shifts},
    Route{"GET", "/v1/lots/{lot}/patterns", Scope::kRead, "", get_lot_patterns},
    Route{"GET", "/v1/lots/{lot}/report", Scope::kRead, "", get_lot_report},
    Route{"GET", "/v1/comparison", Scope::kRead, "lot stand with_lot with_stand", get_comparison},
    Route{"GET", "/v1/stands", Scope::kRead, kPageParameters, list_stands},
    Route{"GET", "/v1/confusion", Scope::kRead, "", get_confusion},
    Route{"GET", "/v1/valves/{serial}", Scope::kRead, "", get_valve},
    Route{"POST", "/v1/valves/{serial}/findings", Scope::kSubmit, "", post_finding},
    Route{"GET", "/v1/valve-types/{type}/references", Scope::kRead, kPageParameters, list_references},
    Route{"POST", "/v1/valve-types/{type}/references", Scope::kAdmin, "", post_reference},
    Route{"GET", "/v1/valve-types/{type}/references/{version}", Scope::kRead, "", get_reference},
    Route{"GET", "/v1/valve-types/{type}/rule-bases", Scope::kRead, kPageParameters, list_rule_bases},
    Route{"POST", "/v1/valve-types/{type}/rule-bases", Scope::kAdmin, "", post_rule_base},
    Route{"GET", "/v1/valve-types/{type}/rule-bases/{version}", Scope::kRead, "", get_rule_base},
    Route{"POST", "/v1/simulations", Scope::kRead, "", post_simulation},
    Route{"GET", "/v1/events", Scope::kRead, "after wait_s limit format", get_events},
    Route{"GET", "/v1/jobs/{id}", Scope::kRead, "", get_job},
    Route{"POST", "/v1/jobs/{id}/cancel", Scope::kSubmit, "", post_cancel},
    Route{"GET", "/v1/tokens", Scope::kAdmin, kPageParameters, list_tokens},
    Route{"POST", "/v1/tokens", Scope::kAdmin, "", post_token},
    Route{"DELETE", "/v1/tokens/{id}", Scope::kAdmin, "", delete_token},
    Route{"GET", "/metrics", Scope::kRead, "", get_metrics},
    Route{"GET", "/openapi.json", Scope::kPublic, "", get_openapi},
    Route{"GET", "/healthz", Scope::kPublic, "", get_healthz},
    Route{"GET", "/readyz", Scope::kPublic, "", get_readyz},
    Route{"GET", "/", Scope::kPublic, "", get_page},
    Route{"GET", "/web/{file}", Scope::kPublic, "", get_page_file},
};

std::string_view next_segment(std::string_view& pattern) {
  pattern.remove_prefix(1);  // the slash
  const auto slash = std::min(pattern.find('/'), pattern.size());
  const std::string_view segment = pattern.substr(0, slash);
  pattern.remove_prefix(slash);
  return segment;
}

bool names_parameter(std::string_view names, std::string_view name) {
  while (!names.empty()) {
    const auto blank = std::min(names.find(' '), names.size());
    if (names.substr(0, blank) == name) return true;
    names.remove_prefix(std::min(blank + 1, names.size()));
  }
  return false;
}

Result<void> check_parameters(const Route& route, const Request& request) {
  for (const auto& [name, value] : request.head.query) {
    if (names_parameter(route.parameters, name)) continue;
    Error error{.code = "unknown_parameter"};
    error.message = fmt::format("'{}' is no parameter of {} {}", name, route.method, route.pattern);
    error.field = name;
    error.expected = route.parameters.empty() ? "no parameters" : std::string(route.parameters);
    return tl::unexpected(error);
  }
  return {};
}

Response call(const Route& route, Service& service, Request& request) {
  if (auto allowed = authorize(service, route.scope, request); !allowed) return problem(allowed.error());
  if (auto known = check_parameters(route, request); !known) return problem(known.error());
  auto response = route.handler(service, request);
  if (response) return std::move(*response);
  if (is_fault(response.error().code)) log_fault(request.id, response.error());
  return problem(response.error());
}

Response no_such_method(const std::string& method, const std::set<std::string_view>& allowed) {
  Response response;
  if (method == "OPTIONS") {
    response.status = 204;
  } else {
    response =
        problem(Error{.code = "method_not_allowed",
                      .message = fmt::format("{} is not possible here, {} is", method, fmt::join(allowed, ", "))});
  }
  response.set_header("Allow", fmt::format("{}", fmt::join(allowed, ", ")));
  return response;
}

}  // namespace

std::string_view to_text(Scope scope) {
  switch (scope) {
    case Scope::kRead:
      return "read";
    case Scope::kSubmit:
      return "submit";
    case Scope::kAdmin:
      return "admin";
    case Scope::kPublic:
      break;
  }
  return "public";
}

std::span<const Route> routes() {
  return kRoutes;
}

bool matches(std::string_view pattern, std::span<const std::string> path, std::vector<std::string>& captures) {
  if (pattern == "/") return path.empty();
  for (const std::string& segment : path) {
    if (pattern.empty()) return false;
    const std::string_view wanted = next_segment(pattern);
    if (wanted.starts_with('{') && !segment.empty()) {
      captures.push_back(segment);
    } else if (wanted != segment) {
      return false;
    }
  }
  return pattern.empty();
}

Response dispatch(Service& service, Request& request) {
  if (auto site = check_site(service, request.head); !site) return problem(site.error());
  const std::string_view method = request.head.method == "HEAD" ? "GET" : std::string_view(request.head.method);
  std::set<std::string_view> allowed;
  for (const Route& route : kRoutes) {
    request.captures.clear();
    if (!matches(route.pattern, request.head.path, request.captures)) continue;
    if (route.method == method) return call(route, service, request);
    allowed.insert(route.method);
    allowed.insert("OPTIONS");
    if (route.method == "GET") allowed.insert("HEAD");
  }
  if (!allowed.empty()) return no_such_method(request.head.method, allowed);
  return problem(Error{.code = "not_found", .message = "there is no such route; /openapi.json lists them"});
}

}  // namespace valvetriage::http
