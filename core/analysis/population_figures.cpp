#include "core/analysis/population_figures.h"

#include <algorithm>

#include "core/identify/valve_fit.h"

namespace valvetriage {
namespace {

/// Back from to_model: both loops out of the one that they make together (loop_of), whose first share is the narrow
/// one.
std::optional<ValveParameters> parameters_of(const Model& model) {
  const auto spool = to_valve_dynamics(model.dynamics);
  if (model.kind != "valve" || !spool || !model.loop || !model.volume || !model.map) return std::nullopt;
  ValveParameters parameters{.spool = *spool, .volume = *model.volume, .mode = model.mode};
  parameters.narrow_loop_width_a = model.loop->width_a * model.loop->shares[0];
  parameters.loop_width_a = model.loop->width_a - parameters.narrow_loop_width_a;
  return parameters;
}

/// Of the map at an input: that of the nearest knot.
double map_sd_at(const Reference& reference, double input_a) {
  const std::vector<double>& knots = reference.model.map->input;
  const auto above = std::lower_bound(knots.begin(), knots.end(), input_a);
  auto nearest = above == knots.end() ? knots.size() - 1 : static_cast<std::size_t>(above - knots.begin());
  if (nearest > 0 && input_a - knots[nearest - 1] < knots[nearest] - input_a) --nearest;
  return reference.map_sd[nearest];
}

}  // namespace

std::vector<PopulationFigure> population_figures(const Model& model, const Reference& reference) {
  const auto parameters = parameters_of(model);
  const bool fits = reference.parameters.size() == kValveParameters.size() && reference.model.map &&
                    reference.map_sd.size() == reference.model.map->input.size();
  if (!parameters || !fits) return {};
  const Eigen::VectorXd vector = to_vector(*parameters);
  std::vector<PopulationFigure> figures;
  for (std::size_t j = 0; j < reference.parameters.size(); ++j) {
    const PopulationParameter& known = reference.parameters[j];
    figures.push_back({.name = known.name,
                       .unit = known.unit,
                       .logarithmic = known.transform == "log",
                       .value = vector(static_cast<Eigen::Index>(j)),
                       .good = {.mean = known.mean, .sd = known.sd, .valves = reference.valves}});
  }
  for (const LevelPopulation& level : reference.levels) {
    figures.push_back({.name = "steady_pressure_psi",
                       .unit = "psi",
                       .level_a = level.level_a,
                       .value = (*model.map)(level.level_a),
                       .good = {.mean = (*reference.model.map)(level.level_a),
                                .sd = map_sd_at(reference, level.level_a),
                                .valves = reference.valves}});
  }
  return figures;
}

}  // namespace valvetriage
