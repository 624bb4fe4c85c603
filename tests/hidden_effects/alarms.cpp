#include "tests/hidden_effects/alarms.h"

namespace valvetriage::hidden_effects {

double exceeded_at(const std::vector<double>& sorted, double rate) {
  constexpr double kFewest = 40;
  const auto draws = static_cast<double>(sorted.size());
  if (rate * draws >= kFewest) return sorted[static_cast<std::size_t>(rate * draws)];
  const double counted = sorted[static_cast<std::size_t>(kFewest)];
  const double signatures = kFewest / draws / tail_of_normal(counted);
  return root_of_falling([&](double z) { return signatures * tail_of_normal(z) - rate; }, counted, 40);
}

}  // namespace valvetriage::hidden_effects
