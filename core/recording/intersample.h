#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// A signal that is known between its samples: over sample interval i it goes straight from start[i] to end[i].
/// end[i] == start[i] is a held command (zero order), end[i] == start[i + 1] a ramp.
struct IntervalSignal {
  std::vector<double> start;
  std::vector<double> end;
  /// Standard deviation of the noise in it where that is known; elsewhere `white_noise` of it tells.
  std::optional<double> noise = std::nullopt;
};

/// What the input does from one sample to the next. Its steps are held until the sample at which it first has its new
/// value; all else goes straight, or is held as well, as what plays a command sample by sample leaves it. Half a sample
/// of error here is 8 times the noise at a step edge.
enum class InputBetween : std::uint8_t { kStraight, kHeld };

/// Whether some of the input is held after steps and some moves on from sample to sample: where it does not, a delay of
/// half a sample is all that straight and held differ by.
bool holds_and_moves(std::span<const Recording> recordings);

/// The input between its samples.
IntervalSignal input_between_samples(const Recording& recording, InputBetween between = InputBetween::kStraight);

/// The same without the white noise of the input's own measurement, which the machine never saw (white_noise.h). It
/// does little through lags, but walks through every memory (a play, a loop) on a hold and eats its width. No window
/// reaches across a step.
IntervalSignal noise_free_input(const Recording& recording, InputBetween between = InputBetween::kStraight);

/// The same signal with every interval cut in half, for what is run at half the sampling period. The noise in it is the
/// one that the samples showed.
IntervalSignal halved(const IntervalSignal& signal);

/// Which intervals are held.
std::vector<bool> held_intervals(const IntervalSignal& signal);

/// Samples between which it is held over some intervals and goes straight over the others; held behind the last.
IntervalSignal held_or_straight(std::vector<double> samples, const std::vector<bool>& held);

/// Of a signal with a value half-way to the next sample, what is at the samples.
std::vector<double> at_samples(const std::vector<double>& halves);

/// Leaves out what follows a gap in which the input cannot be known: a step whose instant is lost, or a curve that no
/// straight line follows. No model can be right there; a few milliseconds of doubt outweigh a small fault.
///
/// settling_s  how long the output remembers an input [s]
/// returns     how many samples were valid before and are not any more
std::size_t leave_out_lost_input(Recording& recording, double settling_s);

}  // namespace valvetriage
