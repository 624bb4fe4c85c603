#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace valvetriage::stand {

/// The current the stand plays: values at the sampling instants; between them linear, except that a step is held until
/// the sample at which the command first has its new value.
struct Command {
  std::string name;  ///< file name without suffix, `step_1.4A`
  std::string test;  ///< the contract's word: step staircase triangle sweep other
  double period_s = 0.005;
  std::vector<double> value_a;
  std::vector<char> is_step;  ///< 1 where value_a[k] is entered by a jump at its instant

  double duration_s() const { return period_s * static_cast<double>(value_a.size()); }
  /// Command at time t ≥ 0, on the near side of the jump at sample `next_step` (no jump is looked through).
  double at(double t_s, std::size_t next_step) const;
  /// Index of the first step after sample k, or value_a.size().
  std::size_t step_after(std::size_t k) const;
};

/// Commands of one test of the repertoire at 200 Hz: step (one per level), staircase, triangle, sweep.
/// Throws std::invalid_argument for a name that the repertoire does not have.
std::vector<Command> commands_of(const std::string& test);

/// A given current on a uniform grid; increments above 20 mA that dwarf both neighbours are steps.
Command command_of_samples(const std::string& name, double period_s, std::vector<double> value_a);

}  // namespace valvetriage::stand
