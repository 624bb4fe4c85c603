#include "core/model/gauge.h"

#include <cmath>

namespace valvetriage {

void read_behind_lag(double lag_s, double sample_period_s, std::span<double> signal) {
  if (!(lag_s > 0) || signal.size() < 2) return;
  // In units of the lag: the parabola through the last three samples, what a lag makes of it once its start is
  // forgotten, and what is left of the start.
  const double angle = sample_period_s / lag_s;
  const double keep = std::exp(-angle), forgotten = -std::expm1(-angle);
  double y = signal[0], before = signal[0], last_rate = 0;
  for (double& value : signal.subspan(1)) {
    const double rate = (value - before) / angle, bend = (rate - last_rate) / angle;
    const double slope = rate - 0.5 * bend * angle - bend;
    const double settled = before - slope;
    const double passed = settled * forgotten + slope * angle + 0.5 * bend * angle * angle;
    y = keep * y + passed;
    last_rate = rate;
    before = value;
    value = y;
  }
}

}  // namespace valvetriage
