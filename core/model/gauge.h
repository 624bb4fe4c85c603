#pragma once

#include <cmath>
#include <span>

namespace valvetriage {

/// A reading behind a first-order lag: the pressure gauge, or one more lag of a valve.
///
///   τ dy/dt = signal − y,   exact for the parabola through the last three samples, from steady state
///
/// lag_s   τ ≥ 0; 0 leaves the reading as it is [s]
/// signal  replaced by the reading
void read_behind_lag(double lag_s, double sample_period_s, std::span<double> signal);

/// The same a sample at a time, lag_s > 0. Value: double, or Eigen's arrays of several signals abreast.
template <typename Value>
class GaugeLag {
 public:
  GaugeLag(double lag_s, double sample_period_s, const Value& first)
      : angle_(sample_period_s / lag_s),
        per_angle_(1 / angle_),
        keep_(std::exp(-angle_)),
        forgotten_(-std::expm1(-angle_)),
        y_(first),
        before_(first),
        last_rate_(0 * first) {}

  /// The reading at the next sample of the signal.
  const Value& next(const Value& value) {
    // In units of the lag: the parabola through the last three samples, what a lag makes of it once its start is
    // forgotten, and what is left of the start.
    const Value rate = (value - before_) * per_angle_;
    const Value bend = (rate - last_rate_) * per_angle_;
    const Value slope = rate - 0.5 * angle_ * bend - bend;
    const Value passed = (before_ - slope) * forgotten_ + slope * angle_ + 0.5 * angle_ * angle_ * bend;
    y_ = keep_ * y_ + passed;
    last_rate_ = rate;
    before_ = value;
    return y_;
  }

 private:
  double angle_, per_angle_, keep_, forgotten_;
  Value y_, before_, last_rate_;
};

}  // namespace valvetriage
