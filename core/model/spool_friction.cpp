#include "core/model/spool_friction.h"

#include <algorithm>
#include <cmath>

namespace valvetriage {
namespace {

constexpr double kStepOverNatural = 0.15;
constexpr int kMostSubsteps = 64;

/// The input at any time, straight inside an interval, held before the first.
class DelayedInput {
 public:
  DelayedInput(const IntervalSignal& input, std::size_t samples, double period_s, double delay_s)
      : input_(input), last_(samples - 1), delay_(delay_s / period_s) {}

  /// time in samples
  double at(double time) const {
    const double t = time - delay_;
    if (t <= 0) return input_.start[0];
    const auto m = std::min(static_cast<std::size_t>(t), last_);
    const double share = std::min(t - static_cast<double>(m), 1.0);
    return input_.start[m] + (input_.end[m] - input_.start[m]) * share;
  }

 private:
  const IntervalSignal& input_;
  std::size_t last_;
  double delay_;
};

}  // namespace

void run_sliding_spool(const ValveDynamics& dynamics, const SpoolFriction& friction, double sample_period_s,
                       const IntervalSignal& input, double offset, std::span<double> position) {
  if (position.empty()) return;
  const double wn = dynamics.natural_frequency_rad_s;
  const int substeps =
      std::clamp(static_cast<int>(std::ceil(wn * sample_period_s / kStepOverNatural)), 2, kMostSubsteps);
  const double h = sample_period_s / substeps;
  const double stiff = 0.25 * h * h * wn * wn, damp = h * dynamics.damping_ratio * wn;
  const double keep = 1 - stiff - damp, push = h * wn * wn, share = 1 / (1 + stiff + damp);
  const double kinetic = std::min(friction.kinetic_a, friction.breakaway_a);
  const double drop = friction.breakaway_a - kinetic;
  const double inverse_speed = 1 / friction.stribeck_a_per_s;
  const DelayedInput delayed(input, position.size(), sample_period_s, dynamics.delay_s);

  double x = delayed.at(0) - offset * friction.breakaway_a;
  double v = 0;
  for (std::size_t i = 0; i < position.size(); ++i) {
    position[i] = x;
    for (int k = 0; k < substeps; ++k) {
      const double u = delayed.at(static_cast<double>(i) + (k + 0.5) / substeps);
      const double relative = v * inverse_speed;
      const double square = relative * relative;
      const double force = kinetic + (square < 30 ? drop * std::exp(-square) : 0);
      // The speed without friction, and what friction takes of it: at most all.
      const double free = v * keep + push * (u - x);
      const double moved = share * (free - std::clamp(free, -push * force, push * force));
      x += 0.5 * h * (v + moved);
      v = moved;
    }
  }
}

}  // namespace valvetriage
