#pragma once

#include <span>

namespace valvetriage {

/// A reading behind a first-order lag: the pressure gauge, or one more lag of a valve.
///
///   τ dy/dt = signal − y,   exact for the parabola through the last three samples, from steady state
///
/// lag_s   τ ≥ 0; 0 leaves the reading as it is [s]
/// signal  replaced by the reading
void read_behind_lag(double lag_s, double sample_period_s, std::span<double> signal);

}  // namespace valvetriage
