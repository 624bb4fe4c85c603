#pragma once

#include <cstdint>
#include <vector>

#include "tests/stand/command.h"
#include "tests/stand/faults.h"
#include "tests/stand/unit.h"

namespace valvetriage::stand {

/// Tolerances of the adaptive integrator; states are scaled so that one figure serves all (A, mm, N, 100 psi).
struct Tolerance {
  double absolute = 1e-6;
  double relative = 1e-6;
};

/// The pressure the sensor gives, without noise, at the sampling instants of the command (README, equations 1 to 9).
///
/// history_seed  what the unit went through before: magnetic loop, stuck spool
/// returns       psi, one value per time in `sample_times_s` (increasing, from 0 to the end of the command)
/// cost          about 1 ms of CPU per second of test; a pure function of its arguments
std::vector<double> run_valve(const Unit& unit, const Faults& faults, const Command& command,
                              std::uint64_t history_seed, const std::vector<double>& sample_times_s,
                              const Tolerance& tolerance = {});

}  // namespace valvetriage::stand
