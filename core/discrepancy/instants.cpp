#include "core/discrepancy/instants.h"

#include <cmath>

#include "core/discrepancy/valve_catalogue.h"

namespace valvetriage {
namespace {

constexpr int kMostRepeats = 4;

/// Sums of a simulation's products with itself and with what was measured.
struct Products {
  double power = 0, shared = 0;

  void add(double simulated, double measured) {
    power += simulated * simulated;
    shared += simulated * measured;
  }
  /// How much of the measured squares the best gain takes.
  double taken() const { return power > 0 ? shared * shared / power : 0; }
};

}  // namespace

std::optional<JointStart> change_of_gain(const Explanation& beside, const LawInFit& law, const Eigen::VectorXd& place) {
  const std::size_t r = *law.recording;
  const Recording& recording = beside.problem->recording(r);
  const std::vector<double> simulated = beside.problem->simulate(place, r);
  const std::vector<double>& measured = recording.output.values;
  Products all, before;
  for (std::size_t i = 0; i < simulated.size(); ++i) {
    if (recording.is_valid(i)) all.add(simulated[i], measured[i]);
  }
  double most = -1, instant_s = 0, change = 0;
  for (std::size_t i = 0; i < simulated.size(); ++i) {
    const double time_s = static_cast<double>(i) * recording.sample_period_s;
    const Products behind{all.power - before.power, all.shared - before.shared};
    const bool is_within = time_s > law.lower[kInstantOf] && time_s < law.upper[kInstantOf];
    if (is_within && before.shared > 0 && behind.shared > 0 && before.taken() + behind.taken() > most) {
      most = before.taken() + behind.taken();
      instant_s = time_s;
      change = (behind.shared / behind.power) / (before.shared / before.power) - 1;
    }
    if (recording.is_valid(i)) before.add(simulated[i], measured[i]);
  }
  if (most < 0) return std::nullopt;
  JointStart start{.baseline = place, .parameters = law.lower};
  start.parameters[kInstantOf] = instant_s - 0.5 * recording.sample_period_s;
  start.parameters[law.law->size_parameter] = change;
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
