#pragma once

#include <functional>
#include <vector>

namespace valvetriage::stand {

/// A smooth curve on a uniform grid, cubic Hermite between the knots, straight beyond the ends.
class Curve {
 public:
  Curve() = default;
  /// Samples `f` on [low, high] with `knots` values.
  Curve(double low, double high, int knots, const std::function<double(double)>& f);
  double operator()(double x) const;

 private:
  double low_ = 0, step_ = 1;
  std::vector<double> value_, slope_;
};

/// Steady pressure [psi] of the nominal unit over coil current [A], 0.6 to 2.4 A: the five published levels
/// 1.2 → 3.1, 1.4 → 26, 1.6 → 120, 1.8 → 160, 2.0 → 210 psig, and 1.0 A → 0.84 at rest. Monotone, smoothed over 25 mA.
const Curve& nominal_steady_pressure_psi();

}  // namespace valvetriage::stand
