#pragma once

#include <span>

namespace valvetriage {

struct ValveDynamics;

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

/// A mode behind a valve's map with the valve's delay. Its spool is prompt: ahead of the map it is run only where
/// something slows it, and then takes its own lag of the delay, or half of what is between its values.
///
/// period_s  at which the spool is run
ValveDynamics delayed_mode(const Mode& mode, const ValveDynamics& spool, bool is_slowed, double period_s);

}  // namespace valvetriage
