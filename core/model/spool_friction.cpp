#include "core/model/spool_friction.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace valvetriage {
namespace {

constexpr double kStepOverNatural = 0.15;
constexpr int kMostSubsteps = 64;
// A lag never arrives; this near it has [A].
constexpr double kArrived = 1e-9;

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

  /// Whether all of the sample interval that begins at sample i sees this one value.
  bool holds(std::size_t i, double value) const {
    const double t = static_cast<double>(i) - delay_;
    const auto first = t <= 0 ? 0 : std::min(static_cast<std::size_t>(t), last_);
    const auto last = std::min(t + 1 <= 0 ? 0 : static_cast<std::size_t>(t + 1), last_);
    for (std::size_t m = first; m <= last; ++m) {
      if (input_.start[m] != value || input_.end[m] != value) return false;
    }
    return true;
  }

 private:
  const IntervalSignal& input_;
  std::size_t last_;
  double delay_;
};

/// Where the slips of a spool begin whose rests are known.
class KnownRests {
 public:
  explicit KnownRests(std::span<const double> rests) : rests_(rests) {}

  void slipped() { has_slipped_ = true; }
  /// For a spool that stands at x at sample i. A rest it has slipped from is no other place to slip from.
  double next_slip_from(std::size_t i, double x) {
    if (rests_.empty() || !has_slipped_ || !std::isfinite(rests_[i]) || rests_[i] == last_) return x;
    has_slipped_ = false;
    last_ = rests_[i];
    return last_;
  }

 private:
  std::span<const double> rests_;
  bool has_slipped_ = true;
  double last_ = std::numeric_limits<double>::quiet_NaN();
};

}  // namespace

int sliding_substeps(const ValveDynamics& dynamics, double sample_period_s) {
  const double steps = std::ceil(dynamics.natural_frequency_rad_s * sample_period_s / kStepOverNatural);
  return static_cast<int>(std::clamp(steps, 2.0, static_cast<double>(kMostSubsteps)));
}

void run_sliding_spool(const ValveDynamics& dynamics, const SpoolFriction& friction, double sample_period_s,
                       const IntervalSignal& input, double offset, std::span<double> position,
                       std::span<const double> rests) {
  if (position.empty()) return;
  const double wn = dynamics.natural_frequency_rad_s;
  const int substeps = sliding_substeps(dynamics, sample_period_s);
  const double h = sample_period_s / substeps;
  const double stiff = 0.25 * h * h * wn * wn, damp = h * dynamics.damping_ratio * wn;
  const double keep = 1 - stiff - damp, push = h * wn * wn, share = 1 / (1 + stiff + damp);
  const double kinetic = std::min(friction.kinetic_a, friction.breakaway_a);
  const double drop = friction.breakaway_a - kinetic;
  const double inverse_speed = 1 / friction.stribeck_a_per_s;
  const DelayedInput delayed(input, position.size(), sample_period_s, dynamics.delay_s);

  const double lag_s = dynamics.lag_s.empty() ? 0 : dynamics.lag_s.front();
  const double half_way = lag_s > 0 ? -std::expm1(-0.5 * h / lag_s) : 1;

  double lagged = delayed.at(0);
  double x = lagged - offset * friction.breakaway_a;
  double v = 0;
  KnownRests known(rests);
  if (!rests.empty() && std::isfinite(rests[0])) x = known.next_slip_from(0, rests[0]);
  double landed = x;
  for (std::size_t i = 0; i < position.size(); ++i) {
    if (v == 0) x = known.next_slip_from(i, x);
    position[i] = v == 0 ? landed : x;
    const bool sticks = v == 0 && std::abs(lagged - x) <= friction.breakaway_a;
    if (sticks && delayed.holds(i, lagged)) continue;
    for (int k = 0; k < substeps; ++k) {
      const double commanded = delayed.at(static_cast<double>(i) + (k + 0.5) / substeps);
      lagged += half_way * (commanded - lagged);
      const double u = lagged;
      lagged += half_way * (commanded - lagged);
      if (std::abs(commanded - lagged) < kArrived) lagged = commanded;
      const double relative = v * inverse_speed;
      const double square = relative * relative;
      const double force = kinetic + (square < 30 ? drop * std::exp(-square) : 0);
      // The speed without friction, and what friction takes of it: at most all.
      const double free = v * keep + push * (u - x);
      const double moved = share * (free - std::clamp(free, -push * force, push * force));
      x += 0.5 * h * (v + moved);
      if (v != 0 && moved == 0) {
        landed = x;
        known.slipped();
      }
      v = moved;
    }
  }
}

}  // namespace valvetriage
