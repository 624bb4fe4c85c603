#pragma once

#include <array>
#include <span>

namespace valvetriage {

/// What a baseline and an extended model leave on one group of held-out samples: sums of squares.
struct HeldOutSquares {
  double baseline = 0, extended = 0;
};

/// 95 % interval of 1 − rms extended / rms baseline (0 where the baseline leaves nothing) by resampling whole groups,
/// from a fixed start: equal input, equal interval.
/// groups  one at least
std::array<double, 2> reduction_interval(std::span<const HeldOutSquares> groups);

}  // namespace valvetriage
