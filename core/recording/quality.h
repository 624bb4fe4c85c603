#pragma once

#include <string_view>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// Judges the samples of a prepared recording and adds what a reader must know to `quality`:
///
/// quantised  at least three levels of the output, each taken five times or more, that lie equally far apart, coarser
///            than two standard deviations of its noise and a thousandth of its range; possibly in part of the range
/// clipped    the output stays exactly at its greatest or least value longer than its own repeats elsewhere explain
///            (chance below 1e-9), or while the input goes on. Removes nothing: it may be the valve's own limit
/// stuck      the output stays exactly at any other value that long: a frozen sensor or logger. So does an output that
///            has one value throughout. A part of it is not judged where the output is quantised or has no noise
/// outliers   one or two samples far off both neighbours (10 standard deviations, 3 % of the range, 4 times the
/// movement
///            around them), never the edge of a step. Replaced by the mean of the neighbours and marked not valid, as
///            long as they are at most one sample in a hundred
/// feedback   the input follows the output: the increment of the input regressed on the present and two past outputs
/// has
///            R² > 0.75, and is not foreseen from its own past (R² < 0.9) as a drawn signal
///            is
///
/// recording  with grid, channels and segments
/// Cost       O(n log n)
void judge_quality(Recording& recording);

/// Samples that a quality item speaks of.
struct QualityPlace {
  std::string_view code;
  std::size_t begin = 0;  ///< first sample of the grid
  std::size_t end = 0;    ///< one past the last
};

/// Where the items of a judged recording stand, in time's order: gap, outliers, clipped and stuck. The others (jitter,
/// quantised, feedback) speak of the whole recording.
///
/// recording  as judge_quality left it
/// Cost       O(n log n)
std::vector<QualityPlace> quality_places(const Recording& recording);

}  // namespace valvetriage
