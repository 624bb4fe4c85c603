#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// Stamps start_s + i · period_s, `size` of them.
struct UniformGrid {
  double start_s = 0;
  double period_s = 0;
  std::size_t size = 0;
  std::vector<std::size_t> gaps;  ///< rows, ascending, ahead of which rows are missing

  bool is_gap_to(std::size_t row) const { return std::ranges::binary_search(gaps, row); }
};

/// Off the grid by more than this part of a period a clock jitters: 0.8 noise at a step edge.
inline constexpr double kJitterRatio = 0.05;

/// Reads a recording whose channels hold a value for each of its own stamps on a uniform grid: sets `jumps` and
/// `input_noise`.
///
/// The input goes straight from row to row and is held until a jump; where the clock jitters, the grid's values are the
/// knots of the lines nearest to it in the mean square, between jumps. What was measured is read off the cubic through
/// four rows, straight beside a jump or a gap. A gap in the input's curve is bridged by a cubic with the slopes of both
/// ends.
///
/// jitters  false where the stamps are the grid's but for gaps: what stands in the rows is then kept to the last bit
/// Cost     O(n)
void resample(Recording& recording, const UniformGrid& grid, bool jitters);

}  // namespace valvetriage
