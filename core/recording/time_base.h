#pragma once

#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// Puts a recording on a uniform grid.
///
/// The period is the mean interval between neighbours (intervals above 1.5 medians, the gaps, left out), so that stamps
/// rounded to a few decimals still give the true one. Stamps within 5 % of a period of the grid, or rounded to a
/// multiple of one resolution, are uniform: the samples stand as they are. Otherwise they jitter, and are interpolated:
/// linearly, and as a zero-order hold across a jump of the input (half a sample of error at a
/// step edge is many times the noise). Grid samples inside a gap are filled in the same way and marked not valid.
/// `quality` gets `jitter` and `gap`.
///
/// raw       channels of equal length; time.values empty where `sample_rate_hz` is given
/// Errors    `time_not_increasing`, `irregular_time` where resampling is not sound: more than a quarter of the
///           intervals differ from the median by more than half of it, or more than half of the grid lies in gaps
/// Cost      O(n); moves the arrays where nothing has to be resampled
Result<Recording> to_uniform_time(RawRecording raw, std::optional<double> sample_rate_hz);

}  // namespace valvetriage
