#pragma once

#include <optional>
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

/// The input between its samples: a step command is held until the sample at which it first has its new value,
/// everything else is linear. Half a sample of error here is 8 times the noise at a step edge.
IntervalSignal input_between_samples(const Recording& recording);

/// The same without the white noise of the input's own measurement, which the machine never saw (white_noise.h). It
/// does little through lags, but walks through every memory (a play, a loop) on a hold and eats its width. No window
/// reaches across a step.
IntervalSignal noise_free_input(const Recording& recording);

/// The same signal with every interval cut in half, for what is run at half the sampling period. The noise in it is the
/// one that the samples showed.
IntervalSignal halved(const IntervalSignal& signal);

/// Of a signal with a value half-way to the next sample, what is at the samples.
std::vector<double> at_samples(const std::vector<double>& halves);

/// Leaves out what follows a gap in which the input cannot be known: a step whose instant is lost, or a curve that no
/// straight line follows. No model can be right there; a few milliseconds of doubt outweigh a small fault.
///
/// settling_s  how long the output remembers an input [s]
/// returns     how many samples were valid before and are not any more
std::size_t leave_out_lost_input(Recording& recording, double settling_s);

}  // namespace valvetriage
