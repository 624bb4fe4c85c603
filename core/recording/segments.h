#pragma once

#include <span>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// Standard deviation of the white noise on a smooth signal, from its second differences: median |Δ²x| / (0.6745 √6).
/// Blind to levels, ramps and the few samples of steps. An oscillation near the sampling rate counts as noise.
double noise_of(std::span<const double> values);

/// What the input does, from first to last sample without holes: holds, steps, ramps and sweeps (see Segment).
///
/// A step is a jump within three samples, above 10 standard deviations of the input's noise and 1.5 % of its range,
/// with little movement before and after; it begins at the first sample past half of the jump. What lies between jumps
/// is a hold, a step where one leads to it, where it moves less than 2 % of the range; else a polyline of ramps and
/// holds where few straight pieces, long enough to be meant, follow it within 1.5 % of the range; else one sweep. Where
/// sweeps are most of the input, all of it is one but for a hold at its start and end.
///
/// input            n values on a uniform grid
/// sample_period_s  [s]
/// Cost             O(n)
std::vector<Segment> find_segments(std::span<const double> input, double sample_period_s);

/// The kind of test that these segments are. Sweep or triangle where sweeps or ramps cover most of the time; a
/// staircase where most steps go on in the direction of the one before, over at least three levels; step where there
/// are others.
TestKind infer_test(const std::vector<Segment>& segments);

/// Whether the input oscillates (sweep, multisine, noise) for most of a recording.
bool oscillates(const Recording& recording);

}  // namespace valvetriage
