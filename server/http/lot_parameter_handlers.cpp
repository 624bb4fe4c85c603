#include "server/http/handlers.h"
#include "server/http/lot_sizes.h"
#include "server/http/stored_history.h"
#include "server/http/views.h"

namespace valvetriage::http {
namespace {

Json view(const report::SizedValve& valve) {
  return Json{{"submission_id", valve.submission_id},
              {"serial", valve.serial.empty() ? Json(nullptr) : Json(valve.serial)},
              {"value", valve.value},
              {"ci95", Json::array({finite_or_null(valve.ci95[0]), finite_or_null(valve.ci95[1])})}};
}

Json view(const report::CauseSizes& cause) {
  Json parameters = Json::array();
  for (const report::ParameterSizes& parameter : cause.parameters) {
    Json values = Json::array();
    for (const report::SizedValve& valve : parameter.values) values.push_back(view(valve));
    parameters.push_back(Json{{"name", parameter.name},
                              {"unit", parameter.unit},
                              {"population_mean", finite_or_null(parameter.population_mean)},
                              {"population_sd", finite_or_null(parameter.population_sd)},
                              {"values", std::move(values)}});
  }
  return Json{{"cause", cause.cause}, {"valves", cause.valves}, {"parameters", std::move(parameters)}};
}

}  // namespace

Result<Response> get_lot_parameters(Service& service, Request& request) {
  const auto lot = service.store.lot(request.captures[0]);
  if (!lot) return tl::unexpected(lot.error());
  const auto history = stored_history(service.store, {.lot = lot->lot});
  if (!history) return tl::unexpected(history.error());
  const auto sizes = lot_sizes(service.store, *history);
  if (!sizes) return tl::unexpected(sizes.error());
  Json items = Json::array();
  for (const report::CauseSizes& cause : sizes->causes) items.push_back(view(cause));
  return json_response(
      Json{{"lot", lot->lot}, {"named", sizes->named}, {"read", sizes->read}, {"items", std::move(items)}});
}

}  // namespace valvetriage::http
