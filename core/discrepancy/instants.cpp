#include "core/discrepancy/instants.h"

#include <cmath>

#include "core/discrepancy/gain_split.h"
#include "core/discrepancy/valve_catalogue.h"

namespace valvetriage {
namespace {

constexpr int kMostRepeats = 4;

}  // namespace

std::optional<JointStart> change_of_gain(const Explanation& beside, const LawInFit& law, const Eigen::VectorXd& place) {
  const std::size_t r = *law.recording;
  const Recording& recording = beside.problem->recording(r);
  const std::vector<GainSplit> splits = split_gains(beside.problem->simulate(place, r), recording.output.values,
                                                    [&](std::size_t i) { return recording.is_valid(i); });
  std::optional<GainSplit> best;
  for (const GainSplit& split : splits) {
    const double time_s = static_cast<double>(split.sample) * recording.sample_period_s;
    const bool is_within = time_s > law.lower[kInstantOf] && time_s < law.upper[kInstantOf];
    if (is_within && (!best || split.taken > best->taken)) best = split;
  }
  if (!best) return std::nullopt;
  JointStart start{.baseline = place, .parameters = law.lower};
  start.parameters[kInstantOf] = (static_cast<double>(best->sample) - 0.5) * recording.sample_period_s;
  start.parameters[law.law->size_parameter] = best->change;
  return start;
}

Explanation at_its_instant(Explanation fitted, const Explanation& beside, const LawFit& law, int most_iterations) {
  for (int repeat = 0; repeat < kMostRepeats; ++repeat) {
    const std::size_t last = fitted.laws.size() - 1;
    const auto start = change_of_gain(beside, law.law, without(fitted, last, 0).v);
    if (!start) break;
    const double moved_s = start->parameters[kInstantOf] - fitted.parameters_of_last()[kInstantOf];
    if (std::abs(moved_s) < beside.problem->recording(*law.law.recording).sample_period_s) break;
    Explanation again = extend(beside, law, most_iterations, fitted.cost, std::vector<JointStart>{*start});
    if (again.cost >= fitted.cost) break;
    fitted = std::move(again);
  }
  return fitted;
}

}  // namespace valvetriage
