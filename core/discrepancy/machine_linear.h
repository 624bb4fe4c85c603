#pragma once

#include <complex>
#include <span>
#include <vector>

#include "core/discrepancy/machine_trials.h"

namespace valvetriage {

/// Rows that a linear machine is solved from, at most: more tell no more about it.
inline constexpr std::size_t kLinearRows = 2000;

/// The linear machine of given sections behind a delay: a numerator of `gain` alone and an offset of none, all free.
LinearMachine linear_machine(std::vector<Section> sections, int dead_samples, double gain, const MachineData& data);

/// The same of poles, moved into what the longest record can tell.
LinearMachine linear_machine(int order, std::span<const std::complex<double>> poles, int dead_samples, double gain,
                             const MachineData& data);

/// The linear machine of an order by output error on all records; empty where the identifier finds none.
std::optional<LinearMachine> identified_linear(const MachineData& data, int order, int dead_samples);

/// Numerator, offset and starts of a linear machine by least squares, given its poles: for those they are linear. An
/// iteration that had to find them beside an integrating pole would be lost in a long flat valley. The fit's squares
/// are those of the rows solved from. False where there is no finite solution.
bool solve_linear(const MachineData& data, LinearMachine& machine);

/// Starts of friction on the input, by the input that a valve which holds would have passed on: for each of a grid of
/// breakaway and kinetic levels that signal is known, so that what follows is one lag, found at
/// once with its delay. In a loop that cycles by friction, a linear machine of the input itself is far from it.
std::vector<MachineFit> held_input_frictions(const MachineData& data, const MachineGround& ground);

/// One lag and delay behind friction on the input of known breakaway and kinetic level, which stay as they are; failed
/// where nothing fits.
MachineFit held_input_friction(const MachineData& data, const MachineGround& ground, double breakaway, double kinetic);

}  // namespace valvetriage
