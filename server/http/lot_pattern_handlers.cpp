#include "server/http/handlers.h"
#include "server/http/stored_history.h"
#include "server/http/stored_patterns.h"
#include "server/http/stored_recording.h"
#include "server/http/views.h"

namespace valvetriage::http {
namespace {

Json numbers(const std::vector<double>& values) {
  Json array = Json::array();
  for (const double value : values) array.push_back(finite_or_null(value));
  return array;
}

Json valve_entry(const SubmissionRow& valve) {
  return Json{
      {"submission_id", valve.id}, {"serial", or_null(valve.labels.serial)}, {"stand", or_null(valve.labels.stand)}};
}

Json view(const LotPattern& pattern, const std::vector<const SubmissionRow*>& compared) {
  Json members = Json::array(), residuals = Json::array();
  for (std::size_t i = 0; i < pattern.members.size(); ++i) {
    Json member = valve_entry(*compared[pattern.members[i]]);
    member["typicality"] = pattern.typicality[i];
    members.push_back(std::move(member));
  }
  for (const GroupResidual& residual : pattern.residuals) {
    residuals.push_back(Json{{"test", residual.test},
                             {"time_s", numbers(residual.time_s)},
                             {"mean", numbers(residual.mean)},
                             {"sd", numbers(residual.sd)},
                             {"good", numbers(residual.good)}});
  }
  return Json{{"members", std::move(members)}, {"residuals", std::move(residuals)}};
}

}  // namespace

Result<Response> get_lot_patterns(Service& service, Request& request) {
  const auto lot = service.store.lot(request.captures[0]);
  if (!lot) return tl::unexpected(lot.error());
  const auto history = stored_history(service.store, {.lot = lot->lot});
  if (!history) return tl::unexpected(history.error());
  const auto place = PlaceForWork::take(service.computations);
  if (!place) return tl::unexpected(place.error());
  const auto patterns = stored_patterns(service, *history);
  if (!patterns) return tl::unexpected(patterns.error());
  Json groups = Json::array(), alone = Json::array();
  for (const LotPattern& group : patterns->groups) groups.push_back(view(group, patterns->compared));
  for (const SubmissionRow* valve : patterns->alone()) alone.push_back(valve_entry(*valve));
  return json_response(Json{{"lot", lot->lot},
                            {"unexplained", patterns->unexplained},
                            {"compared", patterns->compared.size()},
                            {"good_valves", patterns->good_valves},
                            {"groups", std::move(groups)},
                            {"alone", std::move(alone)}});
}

}  // namespace valvetriage::http
