#include "core/discrepancy/gain_split.h"

namespace valvetriage {
namespace {

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

std::vector<GainSplit> split_gains(std::span<const double> simulated, std::span<const double> measured,
                                   const std::function<bool(std::size_t)>& is_valid) {
  Products all, before;
  for (std::size_t i = 0; i < simulated.size(); ++i) {
    if (is_valid(i)) all.add(simulated[i], measured[i]);
  }
  std::vector<GainSplit> splits;
  for (std::size_t i = 0; i < simulated.size(); ++i) {
    const Products behind{all.power - before.power, all.shared - before.shared};
    if (before.shared > 0 && behind.shared > 0) {
      const double change = (behind.shared / behind.power) / (before.shared / before.power) - 1;
      splits.push_back({i, change, before.taken() + behind.taken() - all.taken()});
    }
    if (is_valid(i)) before.add(simulated[i], measured[i]);
  }
  return splits;
}

}  // namespace valvetriage
