#pragma once

#include <vector>

#include "core/discrepancy/linearised_valve.h"

namespace valvetriage {

/// A line in the spectrum of a residual, one frequency in all recordings, a phase of its own in each.
struct Tone {
  double frequency_hz = 0;
  double amplitude = 0;           ///< root mean square over the recordings [unit of the output]
  std::vector<double> phase_rad;  ///< of a sine, one per recording
  double prominence = 0;          ///< power over that of its neighbours
};

/// The most prominent lines of a residual, by the periodogram of every recording over its local background, summed.
///
/// most   how many, the most prominent first; none with fewer than ten periods in the longest recording
/// Cost   O(n log n)
std::vector<Tone> strongest_tones(const LinearisedValve& fit, std::size_t most);

/// Frequencies of the most prominent lines of the logged input while it rests, the most prominent first; see
/// strongest_tones [Hz]
std::vector<double> strongest_input_lines(const ValveFitProblem& problem, std::size_t most);

/// A tone that only some levels have, its frequency following the level.
struct HuntingTone {
  double frequency_hz = 0;  ///< at the level where strongest
  double level = 0;         ///< that level [unit of the output]
  double slope = 0;         ///< relative change of frequency over the whole `range` of outputs
  double amplitude = 0;     ///< at that level [unit of the output]
};

/// The likeliest of them, by the periodograms of the residual on rests of the input: summed over levels along lines
/// f (1 + slope (level − strongest) / range).
///
/// most   how many, the likeliest first
/// Cost   O(n log n)
std::vector<HuntingTone> hunting_tones(const LinearisedValve& fit, double range, std::size_t most);

}  // namespace valvetriage
