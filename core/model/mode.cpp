#include "core/model/mode.h"

#include <algorithm>
#include <cmath>

#include "core/model/valve_dynamics.h"

namespace valvetriage {
namespace {

/// e^{AT} of A = ω [[0, 1], [−1, −2ζ]] on (y, ẏ/ω).
struct Transition {
  double yy, yv, vy, vv;
};
Transition transition(double angle, double damping) {
  const double decay = std::exp(-damping * angle);
  const double detuned = 1 - damping * damping;
  const double root = std::sqrt(std::abs(detuned));
  // cos and sin over root; cosh and sinh where the mode is overdamped, their common limit where it is critical
  double even = 1, odd = angle;
  if (root > 1e-8) {
    even = detuned > 0 ? std::cos(root * angle) : std::cosh(root * angle);
    odd = (detuned > 0 ? std::sin(root * angle) : std::sinh(root * angle)) / root;
  }
  return {decay * (even + damping * odd), decay * odd, -decay * odd, decay * (even - damping * odd)};
}

}  // namespace

ValveDynamics delayed_mode(const Mode& mode, const ValveDynamics& spool, bool is_slowed, double period_s) {
  const double taken_s = is_slowed ? std::max(2 / spool.natural_frequency_rad_s, 0.5 * period_s) : 0;
  return {.delay_s = std::max(0.0, spool.delay_s - taken_s),
          .natural_frequency_rad_s = mode.natural_frequency_rad_s,
          .damping_ratio = mode.damping_ratio};
}

void read_behind_mode(const Mode& mode, double sample_period_s, std::span<double> signal) {
  if (signal.size() < 2) return;
  const double angle = mode.natural_frequency_rad_s * sample_period_s;
  const double damping = mode.damping_ratio;
  const Transition e = transition(angle, damping);
  double y = signal[0], v = 0, before = signal[0], last_rate = 0;
  for (double& value : signal.subspan(1)) {
    // In units of 1/ω: the parabola through the last three samples, what the mode makes of it once all ringing has
    // died, and what rings about that.
    const double rate = (value - before) / angle, bend = (rate - last_rate) / angle;
    const double slope = rate - 0.5 * bend * angle - 2 * damping * bend;  // of the settled answer, at the start
    const double settled = before - 2 * damping * slope - bend;
    const double apart = y - settled, rate_apart = v - slope;
    y = settled + slope * angle + 0.5 * bend * angle * angle + e.yy * apart + e.yv * rate_apart;
    v = slope + bend * angle + e.vy * apart + e.vv * rate_apart;
    last_rate = rate;
    before = value;
    value = y;
  }
}

}  // namespace valvetriage
