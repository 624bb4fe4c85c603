#pragma once

#include <vector>

#include "tests/stand/command.h"
#include "tests/stand/environment.h"
#include "tests/stand/faults.h"
#include "tests/stand/integration.h"
#include "tests/stand/unit.h"

namespace valvetriage::stand {

/// The pressure the gauge gives, without noise, at the sampling instants (README, equations 1 to 9).
///
/// sample_times_s  increasing, from 0 on; beyond its end the command holds
/// returns         psi, one value per sample time
/// cost            about 2 ms of CPU per second of test; a pure function of its arguments
std::vector<double> run_valve(const Unit& unit, const Faults& faults, const Command& command,
                              const Environment& environment, const std::vector<double>& sample_times_s,
                              const Tolerance& tolerance = {});

}  // namespace valvetriage::stand
