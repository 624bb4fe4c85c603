#pragma once

#include <span>

namespace valvetriage {

/// A second-order system of static gain 1:  ÿ = ω² (y_in − y) − 2 ζ ω ẏ.
struct Mode {
  double natural_frequency_rad_s = 0;  ///< ω > 0
  double damping_ratio = 1;            ///< ζ > 0; from 1 on two lags

  bool operator==(const Mode&) const = default;
};

/// A reading behind a mode that rests at the signal's first sample; exact for the parabola through the last three
/// samples.
///
/// signal  replaced by the reading
/// Source  Franklin, Powell, Workman, Digital Control (1998), invariant to ramps and parabolas
void read_behind_mode(const Mode& mode, double sample_period_s, std::span<double> signal);

}  // namespace valvetriage
