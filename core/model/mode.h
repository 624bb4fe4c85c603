#pragma once

#include <cmath>
#include <span>

namespace valvetriage {

/// A second-order system of static gain 1:  ÿ = ω² (y_in − y) − 2 ζ ω ẏ.
struct Mode {
  double natural_frequency_rad_s = 0;  ///< ω > 0
  double damping_ratio = 1;            ///< ζ > 0; from 1 on two lags

  bool operator==(const Mode&) const = default;
};

/// e^{AT} of A = ω [[0, 1], [−1, −2ζ]] on (y, ẏ/ω).
struct ModeTransition {
  double yy, yv, vy, vv;

  ModeTransition(double angle, double damping) {
    const double decay = std::exp(-damping * angle);
    const double detuned = 1 - damping * damping;
    const double root = std::sqrt(std::abs(detuned));
    // cos and sin over root; cosh and sinh where the mode is overdamped, their common limit where it is critical
    double even = 1, odd = angle;
    if (root > 1e-8) {
      even = detuned > 0 ? std::cos(root * angle) : std::cosh(root * angle);
      odd = (detuned > 0 ? std::sin(root * angle) : std::sinh(root * angle)) / root;
    }
    yy = decay * (even + damping * odd);
    yv = decay * odd;
    vy = -decay * odd;
    vv = decay * (even - damping * odd);
  }
};

/// A mode a sample at a time, exact for the parabola through the last three samples. Value: double, or Eigen's arrays
/// of several signals abreast.
///
/// first        the signal's first sample, at which the mode rests
/// apart, rate  how far from there it is, and how fast in units of it per 1/ω
///
/// Source  Franklin, Powell, Workman, Digital Control (1998), invariant to ramps and parabolas
template <typename Value>
class ModeFilter {
 public:
  ModeFilter(const Mode& mode, double sample_period_s, const Value& first, double apart = 0, double rate = 0)
      : angle_(mode.natural_frequency_rad_s * sample_period_s),
        damping_(mode.damping_ratio),
        e_(angle_, damping_),
        y_(first + apart),
        v_(0 * first + rate),
        before_(first),
        last_rate_(0 * first) {}

  const Value& reading() const { return y_; }

  /// The reading at the next sample of the signal.
  const Value& next(const Value& value) {
    // In units of 1/ω: the parabola through the last three samples, what the mode makes of it once all ringing has
    // died, and what rings about that.
    const Value rate = (value - before_) / angle_, bend = (rate - last_rate_) / angle_;
    const Value slope = rate - 0.5 * angle_ * bend - 2 * damping_ * bend;  // of the settled answer, at the start
    const Value settled = before_ - 2 * damping_ * slope - bend;
    const Value apart = y_ - settled, rate_apart = v_ - slope;
    y_ = settled + slope * angle_ + 0.5 * angle_ * angle_ * bend + e_.yy * apart + e_.yv * rate_apart;
    v_ = slope + bend * angle_ + e_.vy * apart + e_.vv * rate_apart;
    last_rate_ = rate;
    before_ = value;
    return y_;
  }

 private:
  double angle_, damping_;
  ModeTransition e_;
  Value y_, v_, before_, last_rate_;
};

/// A signal behind a mode that is `apart` and moves with `rate` at the first sample.
inline void read_behind_mode(const Mode& mode, double sample_period_s, std::span<double> signal, double apart = 0,
                             double rate = 0) {
  if (signal.empty()) return;
  ModeFilter<double> filter(mode, sample_period_s, signal.front(), apart, rate);
  signal.front() = filter.reading();
  for (double& value : signal.subspan(1)) value = filter.next(value);
}

}  // namespace valvetriage
