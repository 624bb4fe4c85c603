#include <algorithm>

#include "core/mechanisms/mechanism.h"
#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/stored_history.h"
#include "server/http/views.h"

namespace valvetriage::http {
namespace {

/// A parameter of one cause over the valves that have it.
Json& parameter_entry(Json& entry, const std::string& name, const Json& estimate) {
  for (Json& known : entry["parameters"]) {
    if (known["name"] == name) return known;
  }
  entry["parameters"].push_back(Json{{"name", name},
                                     {"unit", estimate.value("unit", Json(""))},
                                     {"population_mean", estimate.value("population_mean", Json())},
                                     {"population_sd", estimate.value("population_sd", Json())},
                                     {"values", Json::array()}});
  return entry["parameters"].back();
}

Json& cause_entry(Json& items, const std::string& cause) {
  for (Json& known : items) {
    if (known["cause"] == cause) return known;
  }
  items.push_back(Json{{"cause", cause}, {"valves", 0}, {"parameters", Json::array()}});
  return items.back();
}

/// What every recording has its own of says nothing about the valve.
bool is_own_per_recording(const std::string& cause, const std::string& name) {
  const Mechanism* law = find_mechanism(cause);
  if (law == nullptr) return false;
  const auto own = law->parameters.last(law->own_per_recording);
  return std::any_of(own.begin(), own.end(), [&](const MechanismParameter& p) { return p.name == name; });
}

void add_cause(Json& items, const SubmissionRow& valve, const Json& found) {
  const std::string cause = found.value("cause", "");
  Json& entry = cause_entry(items, cause);
  entry["valves"] = entry["valves"].get<int>() + 1;
  const Json parameters = found.value("parameters", Json::object());
  for (const auto& [name, estimate] : parameters.items()) {
    if (!estimate.is_object() || !estimate.value("value", Json()).is_number()) continue;
    if (is_own_per_recording(cause, name)) continue;
    parameter_entry(entry, name, estimate)["values"].push_back(
        Json{{"submission_id", valve.id},
             {"serial", valve.labels.serial ? Json(*valve.labels.serial) : Json(nullptr)},
             {"value", estimate["value"]},
             {"ci95", estimate.value("ci95", Json::array({nullptr, nullptr}))}});
  }
}

}  // namespace

Result<Response> get_lot_parameters(Service& service, Request& request) {
  const auto lot = service.store.lot(request.captures[0]);
  if (!lot) return tl::unexpected(lot.error());
  const auto history = stored_history(service.store, {.lot = lot->lot});
  if (!history) return tl::unexpected(history.error());
  Json items = Json::array();
  std::size_t named = 0, read = 0;
  for (auto valve = history->valves.rbegin(); valve != history->valves.rend(); ++valve) {
    if (settled_causes(*valve).empty()) continue;
    if (++named > kMaxNamedValves) continue;
    const auto causes = named_causes(service.store, *valve);
    if (!causes) return tl::unexpected(causes.error());
    for (const Json& cause : *causes) add_cause(items, *valve, cause);
    ++read;
  }
  std::stable_sort(items.begin(), items.end(), [](const Json& a, const Json& b) { return a["valves"] > b["valves"]; });
  return json_response(Json{{"lot", lot->lot}, {"named", named}, {"read", read}, {"items", std::move(items)}});
}

}  // namespace valvetriage::http
