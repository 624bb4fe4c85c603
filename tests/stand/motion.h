#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/stand/session.h"

namespace valvetriage::stand {

/// A bipolar, unitless mass on a spring beside the valve, for what a valve cannot show: a sensor that only knows
/// magnitudes, a spring that stiffens to both sides.
///
///   y″ = ω² (K u* − y − c y³) − 2 ζ ω y′ − ω² f       u* = input behind dead band, loop and play;  f LuGre friction
///
/// Sizes are in the units of the input (friction, backlash, hysteresis, dead_band), of the output (saturation: rms over
/// level, sensor_offset), or of y⁻² (stiffening_spring). Effects: see `motion_effects`.
const std::vector<std::string>& motion_effects();

/// Three recordings (low, high, steps) of the plant drawn from the unit seed; columns time_s,u,y.
/// Throws std::invalid_argument for an effect that the plant does not have.
Session run_motion(const SessionOptions& options);

}  // namespace valvetriage::stand
