#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace valvetriage::stand {

/// The current the stand plays: values at the sampling instants; between them linear, except that a step is held until
/// the sample at which the command first has its new value. For a unitless plant the values are its input.
struct Command {
  std::string name;  ///< file name without suffix, `step_1.4A`
  std::string test;  ///< the contract's word: step staircase triangle sweep other
  double period_s = 0.005;
  std::vector<double> value_a;
  std::vector<char> is_step;  ///< 1 where value_a[k] is entered by a jump at its instant
  std::vector<double>
      tick_s;  ///< instants of the values where the clock jitters by less than half a period; else empty
  double dither_a = 0, dither_hz = 0;

  /// When value k is played, and its sample taken: one loop writes the command and reads the gauge.
  double instant_s(std::size_t k) const { return tick_s.empty() ? static_cast<double>(k) * period_s : tick_s[k]; }
  double duration_s() const { return period_s * static_cast<double>(value_a.size()); }
  /// Command at time t on the near side of the jump at sample `next_step` (no jump is looked through), without dither.
  double at(double t_s, std::size_t next_step) const;
  /// Command at time t as a monitor sees it.
  double at(double t_s) const;
  double dither_at(double t_s) const;
  /// Last value played at or before t ≥ 0.
  std::size_t index_at(double t_s) const;
  /// Index of the first step after sample k, or value_a.size().
  std::size_t step_after(std::size_t k) const;
  /// When the command steps there; never where `step` is value_a.size().
  double step_time_s(std::size_t step) const;
};

/// Names of the repertoire: steps (five levels in one recording), step (a recording per level), step_up, staircase,
/// triangle, triangle_fast, sweep (medium amplitude), sweep_high, multisine.
const std::vector<std::string>& repertoire();

/// Commands of one test of the repertoire at 200 Hz.
/// Throws std::invalid_argument for a name that the repertoire does not have.
std::vector<Command> commands_of(const std::string& test);

/// Odd random-phase multisine: `period_s` long, odd lines up to `highest_hz` but one of every four left out at random
/// (odd detection lines), no even lines (even detection lines); rms 1, `periods` times.
std::vector<double> multisine(double sample_period_s, double period_s, double highest_hz, int periods);

/// A given current on a uniform grid; increments above 20 mA that dwarf both neighbours are steps.
Command command_of_samples(const std::string& name, double period_s, std::vector<double> value_a);

}  // namespace valvetriage::stand
