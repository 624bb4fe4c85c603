#include "server/http/lot_sizes.h"

#include <algorithm>
#include <cmath>

#include "core/mechanisms/mechanism.h"
#include "server/http/limits.h"
#include "server/http/stored_history.h"

namespace valvetriage::http {
namespace {

double number_or_nan(const Json& value) {
  return value.is_number() ? value.get<double>() : std::nan("");
}

template <typename Entry>
Entry& entry_of(std::vector<Entry>& entries, const std::string Entry::*name, const std::string& wanted, Entry fresh) {
  const auto known = std::find_if(entries.begin(), entries.end(), [&](const Entry& e) { return e.*name == wanted; });
  return known == entries.end() ? entries.emplace_back(std::move(fresh)) : *known;
}

/// What says where or which, or what every recording has its own of, is no size of the cause.
bool is_no_size(const std::string& cause, const std::string& name) {
  if (name == "recording" || name == "ahead_of_map" || name == "spool_stops") return true;
  const Mechanism* law = find_mechanism(cause);
  if (law == nullptr) return false;
  const auto own = law->parameters.last(law->own_per_recording);
  return std::any_of(own.begin(), own.end(), [&](const MechanismParameter& p) { return p.name == name; });
}

void add_cause(report::LotSizes& sizes, const SubmissionRow& valve, const Json& found) {
  const std::string cause = found.value("cause", "");
  report::CauseSizes& entry =
      entry_of(sizes.causes, &report::CauseSizes::cause, cause, {.cause = cause, .valves = 0, .parameters = {}});
  ++entry.valves;
  const Json parameters = found.value("parameters", Json::object());
  for (const auto& [name, estimate] : parameters.items()) {
    if (!estimate.is_object() || !estimate.value("value", Json()).is_number()) continue;
    if (is_no_size(cause, name)) continue;
    const Json ci95 = estimate.value("ci95", Json::array());
    const bool bounded = ci95.is_array() && ci95.size() == 2;
    entry_of(entry.parameters, &report::ParameterSizes::name, name,
             {.name = name,
              .unit = estimate.value("unit", ""),
              .population_mean = number_or_nan(estimate.value("population_mean", Json())),
              .population_sd = number_or_nan(estimate.value("population_sd", Json())),
              .values = {}})
        .values.push_back({.submission_id = valve.id,
                           .serial = valve.labels.serial.value_or(""),
                           .value = estimate["value"].get<double>(),
                           .ci95 = {bounded ? number_or_nan(ci95[0]) : std::nan(""),
                                    bounded ? number_or_nan(ci95[1]) : std::nan("")}});
  }
}

}  // namespace

Result<report::LotSizes> lot_sizes(Store& store, const LotHistory& history) {
  report::LotSizes sizes;
  for (auto valve = history.valves.rbegin(); valve != history.valves.rend(); ++valve) {
    if (settled_causes(*valve).empty()) continue;
    if (++sizes.named > kMaxNamedValves) continue;
    const auto causes = named_causes(store, *valve);
    if (!causes) return tl::unexpected(causes.error());
    for (const Json& cause : *causes) add_cause(sizes, *valve, cause);
    ++sizes.read;
  }
  std::stable_sort(sizes.causes.begin(), sizes.causes.end(),
                   [](const auto& a, const auto& b) { return a.valves > b.valves; });
  return sizes;
}

}  // namespace valvetriage::http
