#include "server/report/downsample.h"

#include <algorithm>
#include <cmath>

namespace valvetriage::report {
namespace {

void add(Points& points, std::span<const double> time_s, std::span<const double> value, std::size_t i) {
  points.time_s.push_back(time_s[i]);
  points.value.push_back(value[i]);
}

/// The smallest and the largest sample of [begin, end), in the order of time; one where they are the same.
void add_extremes(Points& points, std::span<const double> time_s, std::span<const double> value, std::size_t begin,
                  std::size_t end) {
  while (begin < end && std::isnan(value[begin])) ++begin;
  if (begin == end) return;
  std::size_t smallest = begin, largest = begin;
  for (std::size_t i = begin + 1; i < end; ++i) {
    if (value[i] < value[smallest]) smallest = i;
    if (value[i] > value[largest]) largest = i;
  }
  add(points, time_s, value, std::min(smallest, largest));
  if (smallest != largest) add(points, time_s, value, std::max(smallest, largest));
}

}  // namespace

Points downsample(std::span<const double> time_s, std::span<const double> value, double from, double to,
                  std::size_t points) {
  const auto first = static_cast<std::size_t>(std::lower_bound(time_s.begin(), time_s.end(), from) - time_s.begin());
  const auto last = static_cast<std::size_t>(std::upper_bound(time_s.begin(), time_s.end(), to) - time_s.begin());
  Points shown;
  if (first >= last) return shown;
  const std::size_t n = last - first;
  const std::size_t runs = n <= points ? n : points / 2;
  for (std::size_t run = 0; run < runs; ++run) {
    add_extremes(shown, time_s, value, first + n * run / runs, first + n * (run + 1) / runs);
  }
  return shown;
}

}  // namespace valvetriage::report
