#include <fmt/format.h>

#include "core/mechanisms/mechanism.h"
#include "server/http/handlers.h"
#include "server/http/subject.h"
#include "server/http/views.h"
#include "server/report/sentence.h"

namespace valvetriage::http {
namespace {

Json cause_view(const Mechanism& law) {
  Json parameters = Json::array();
  for (const MechanismParameter& parameter : law.parameters) {
    parameters.push_back(Json{{"name", parameter.name}, {"unit", parameter.unit}, {"meaning", parameter.meaning}});
  }
  Json confused_with = Json::array();
  for (const std::string_view cause : law.confused_with) confused_with.push_back(cause);
  return Json{
      {"cause", law.cause}, {"family", law.family},       {"origin", law.origin},           {"wrong", law.wrong},
      {"law", law.law},     {"signature", law.signature}, {"confused_with", confused_with}, {"parameters", parameters}};
}

}  // namespace

Result<Response> get_summary(Service& service, Request& request) {
  const auto submission = submission_asked_for(service, request);
  if (!submission) return tl::unexpected(submission.error());
  const auto row = analysis_asked_for(service, *submission);
  if (!row) return tl::unexpected(row.error());
  const auto read = stored_analysis(service, *row);
  if (!read) return tl::unexpected(read.error());
  const report::Summary summary = report::summarise(read->analysis);
  return json_response(Json{{"analysis_id", row->id},
                            {"verdict", summary.verdict},
                            {"discrepancy", summary.discrepancy},
                            {"causes", summary.causes},
                            {"fault", summary.fault},
                            {"gain", summary.gain},
                            {"upper_limits", summary.upper_limits},
                            {"next_test", summary.next_test}});
}

Result<Response> list_causes(Service&, Request& request) {
  std::vector<Json> items;
  for (const Mechanism* law : all_mechanisms()) items.push_back(cause_view(*law));
  return whole_list_response(request, std::move(items));
}

}  // namespace valvetriage::http
