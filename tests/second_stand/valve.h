#pragma once

#include <vector>

#include "tests/second_stand/command.h"
#include "tests/second_stand/day.h"
#include "tests/second_stand/faults.h"
#include "tests/second_stand/unit.h"

namespace valvetriage::second_stand {

/// How finely the valve is computed.
constexpr double kStepS = 0.00025;

/// Noise-free pressure that the gauge tells at the instants of the command's values (README, 1 to 10).
/// `dither_a` is a small sine of 201.3 Hz that the driver adds to the command.
std::vector<double> play_valve(const Unit& unit, const Faults& faults, const Command& command, const Day& day,
                               double dither_a = 0, double step_s = kStepS);

constexpr double kDitherHz = 201.3;

/// Steady pressure at a current with its memories at the middle of their loops, static faults included.
double steady_psi(const Unit& unit, const Faults& faults, double current_a);

}  // namespace valvetriage::second_stand
