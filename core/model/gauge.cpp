#include "core/model/gauge.h"

#include <cmath>

namespace valvetriage {

void read_behind_lag(double lag_s, double sample_period_s, std::span<double> signal) {
  if (!(lag_s > 0) || signal.size() < 2) return;
  // y_{i+1} = a y_i + (φ − a) u_i + (1 − φ) u_{i+1},   a = e^(−T/τ),  φ = (1 − a) τ / T
  const double ratio = sample_period_s / lag_s;
  const double a = std::exp(-ratio);
  const double phi = -std::expm1(-ratio) / ratio;
  double y = signal[0], before = signal[0];
  for (double& value : signal.subspan(1)) {
    y = a * y + (phi - a) * before + (1 - phi) * value;
    before = value;
    value = y;
  }
}

}  // namespace valvetriage
