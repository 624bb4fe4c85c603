#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>
#include <vector>

namespace valvetriage::hidden_effects {

/// False alarms of the whole search, over all causes together.
constexpr std::array<double, 2> kAlarms = {0.01, 0.001};
/// Standard deviations of a normal that nine in ten lie above minus.
constexpr double kNineInTen = 1.2815515655446004;

/// What seeing one cause costs an observer.
struct SearchOf {
  std::string cause;
  std::array<double, kAlarms.size()> threshold;  ///< of what is searched for the greatest, standard deviations
  std::array<double, kAlarms.size()> d90;        ///< the distance d that is seen nine times in ten
};

/// That of one cause, where `causes` share one (Bonferroni 1936).
inline double share_of(double alarm, std::size_t causes) {
  return alarm / static_cast<double>(causes);
}

inline double tail_of_normal(double z) {
  return 0.5 * std::erfc(z / std::numbers::sqrt2);
}

/// The root of a falling function.
template <class Function>
double root_of_falling(Function value, double low, double high) {
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (value(middle) > 0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

/// The threshold that is exceeded at `rate` by draws, the largest first; below 40 drawn exceedances the tail is that of
/// as many independent signatures as make the last rate that was counted.
double exceeded_at(const std::vector<double>& sorted, double rate);

}  // namespace valvetriage::hidden_effects
