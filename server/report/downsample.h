#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace valvetriage::report {

/// A series as it is shown.
struct Points {
  std::vector<double> time_s;
  std::vector<double> value;
};

/// At most `points` of the samples whose time lies in [from, to], so that every peak stays: the samples are cut into
/// points/2 runs of equal length, and of each the smallest and the largest stand in the result, in their order. Fewer
/// samples than points are all given. NaN samples (nothing there) are left out.
///
/// time_s  n increasing stamps; value  n values
/// points  at least 2
/// Cost    O(n)
Points downsample(std::span<const double> time_s, std::span<const double> value, double from, double to,
                  std::size_t points);

}  // namespace valvetriage::report
