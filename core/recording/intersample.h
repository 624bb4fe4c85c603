#pragma once

#include <span>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// A signal that is known between its samples: over sample interval i it goes straight from start[i] to end[i].
/// end[i] == start[i] is a held command (zero order), end[i] == start[i + 1] a ramp.
struct IntervalSignal {
  std::vector<double> start;
  std::vector<double> end;
};

/// The input between its samples: a step command is held until the sample at which it first has its new value,
/// everything else is linear. Half a sample of error here is 8 times the noise at a step edge.
IntervalSignal input_between_samples(const Recording& recording);

/// The same without the white noise of the input's own measurement, which the machine never saw. It does little through
/// lags, but walks through every memory (a play, a loop) on a hold and eats its width.
///
/// Each sample becomes the mean, or the middle of a parabola, over the widest window around it that agrees with those
/// of all narrower ones within their errors (intersection of confidence intervals: Goldenshluger and Nemirovski, Math.
/// Meth. Statist. 6 (1997) 135), whichever is the more certain; no window reaches across a step. What moves faster than
/// the noise stays as it was logged; an input without noise is returned to the last bit.
///
/// Cost  O(n) for each window of means, O(n · length) for each of parabolas
IntervalSignal noise_free_input(const Recording& recording);

/// Standard deviation of a signal's white noise, from the lower quartile of its third, sixth and ninth differences, the
/// least of them: the edges of steps do not count, and a sine up to a tenth of the sampling rate leaves nothing in the
/// ninth. 0 for fewer than eight samples.
double white_noise(std::span<const double> signal);

/// Leaves out what follows a gap in which the input cannot be known: a step whose instant is lost, or a curve that no
/// straight line follows. No model can be right there; a few milliseconds of doubt outweigh a small fault.
///
/// settling_s  how long the output remembers an input [s]
/// returns     how many samples were valid before and are not any more
std::size_t leave_out_lost_input(Recording& recording, double settling_s);

}  // namespace valvetriage
