#include "server/http/lot_shifts.h"

#include <algorithm>
#include <compare>
#include <map>
#include <string>
#include <utility>

#include "core/classify/shared_shift.h"
#include "server/http/limits.h"
#include "server/http/stored_history.h"
#include "server/wire/model_json.h"
#include "server/wire/reference_json.h"

namespace valvetriage::http {
namespace {

/// A reference as an analysis names it, and which of its populations the valve was compared with.
struct ReferenceName {
  std::string valve_type;
  int version = 0;
  bool on_known_tests = false;

  auto operator<=>(const ReferenceName&) const = default;
};

struct FittedValve {
  ReferenceName reference;
  Model model;
};

/// Nothing where the valve was not compared with a stored reference.
Result<std::optional<FittedValve>> fitted_valve(Store& store, const SubmissionRow& row) {
  const auto document = newest_document(store, row);
  if (!document) return tl::unexpected(document.error());
  const Json baseline = document->value("baseline", Json::object());
  const Json reference = baseline.value("reference", Json());
  if (!reference.is_object() || reference.value("version", 0) == 0) return std::nullopt;
  const auto model = model_from_json(baseline.value("model", Json()));
  if (!model) return std::nullopt;
  return FittedValve{.reference = {reference.value("valve_type", ""), reference.value("version", 0),
                                   reference.value("on_known_tests", false)},
                     .model = *model};
}

bool takes_part(const SubmissionRow& row) {
  const auto& conclusion = row.summary.conclusion;
  return (conclusion == "none" || conclusion == "ambiguous") && settled_causes(row).empty();
}

/// Every figure over the valves; the first valve gives names and population.
std::vector<report::FigureShift> shifts_of(const std::vector<std::vector<PopulationFigure>>& valves) {
  std::vector<report::FigureShift> shifts;
  if (valves.empty()) return shifts;
  for (std::size_t f = 0; f < valves.front().size(); ++f) {
    std::vector<double> values;
    for (const auto& figures : valves) values.push_back(figures[f].value);
    const auto shift = shared_shift(values, valves.front()[f].good);
    if (shift) shifts.push_back({.figure = valves.front()[f], .shift = *shift});
  }
  std::vector<double> p_values;
  for (const auto& found : shifts) p_values.push_back(found.shift.p_value);
  const std::vector<double> adjusted = holm_adjusted(p_values);
  for (std::size_t i = 0; i < shifts.size(); ++i) shifts[i].p_adjusted = adjusted[i];
  std::stable_sort(shifts.begin(), shifts.end(),
                   [](const auto& a, const auto& b) { return a.shift.p_value < b.shift.p_value; });
  return shifts;
}

}  // namespace

Result<report::LotShifts> lot_shifts(Store& store, const LotHistory& history) {
  report::LotShifts shifts;
  std::map<ReferenceName, std::vector<Model>> fits;
  for (auto row = history.valves.rbegin(); row != history.valves.rend(); ++row) {
    if (!takes_part(*row) || ++shifts.fitting > kMaxShiftValves) continue;
    auto fitted = fitted_valve(store, *row);
    if (!fitted) return tl::unexpected(fitted.error());
    if (*fitted) fits[(*fitted)->reference].push_back(std::move((*fitted)->model));
  }
  const auto most = std::max_element(fits.begin(), fits.end(),
                                     [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  if (most == fits.end()) return shifts;
  const auto& [valve_type, version, on_known_tests] = most->first;
  const auto stored = store.document(DocumentKind::kReference, valve_type, version);
  if (!stored && stored.error().code == "not_found") return shifts;
  if (!stored) return tl::unexpected(stored.error());
  const auto reference = parse_json(stored->body_json).and_then(reference_from_json);
  if (!reference) return tl::unexpected(reference.error());
  shifts.valve_type = valve_type;
  shifts.reference_version = version;
  std::vector<std::vector<PopulationFigure>> valves;
  const bool is_nested = on_known_tests && !reference->on_known_tests.empty();
  const Reference& population = is_nested ? reference->on_known_tests.front().reference : *reference;
  for (const Model& model : most->second) {
    auto figures = population_figures(model, population);
    if (!figures.empty()) valves.push_back(std::move(figures));
  }
  shifts.good_valves = population.valves;
  shifts.valves = valves.size();
  shifts.figures = shifts_of(valves);
  return shifts;
}

}  // namespace valvetriage::http
