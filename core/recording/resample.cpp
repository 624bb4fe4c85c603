#include "core/recording/resample.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <utility>

#include "core/recording/white_noise.h"

namespace valvetriage {
namespace {

constexpr double kJumpRatio = 0.02;      // of the input's range within one interval: a jump, not a slope,
constexpr double kSteepBeside = 0.2;     // unless the intervals beside it rise as much as this part of it
constexpr std::size_t kSlopePoints = 5;  // of the parabola that gives the slope at the edge of a gap
constexpr double kShortInterval = 0.5;   // of a period: stamps so close would make a cubic's noise large
constexpr double kSmootherByRows = 1;    // times the noise in time, which interpolation can only lower
constexpr double kRounding = 1e-6;       // of a period: a mean of intervals, many times over, is off a stamp by less

/// Whether values[i] − values[i − 1] is a step on its own: a steep slope goes on beside it.
bool is_jump(const std::vector<double>& values, std::size_t i, double least) {
  const double rise = std::abs(values[i] - values[i - 1]);
  if (!(rise > least)) return false;
  const double before = i >= 2 ? std::abs(values[i - 1] - values[i - 2]) : 0;
  const double after = i + 1 < values.size() ? std::abs(values[i + 1] - values[i]) : 0;
  return std::max(before, after) < kSteepBeside * rise;
}

/// Slope at stamp `at` of the parabola through it and nearest to four more: before it (side 1) or behind it (side −1).
double end_slope(const std::vector<double>& time, const std::vector<double>& values, std::size_t at, int side) {
  double s2 = 0, s3 = 0, s4 = 0, r1 = 0, r2 = 0;
  for (int k = 1; k < static_cast<int>(kSlopePoints); ++k) {
    const auto i = static_cast<std::ptrdiff_t>(at) - side * k;
    if (i < 0 || i >= static_cast<std::ptrdiff_t>(time.size())) return 0;
    const double t = time[static_cast<std::size_t>(i)] - time[at];
    const double v = values[static_cast<std::size_t>(i)] - values[at];
    s2 += t * t, s3 += t * t * t, s4 += t * t * t * t;
    r1 += t * v, r2 += t * t * v;
  }
  const double determinant = s2 * s4 - s3 * s3;
  return determinant > 0 ? (r1 * s4 - r2 * s3) / determinant : 0;
}

/// Whether the stamps from which slopes at a gap are taken hold no step.
bool is_smooth_beside(const std::vector<double>& values, std::size_t right, double jump) {
  const std::size_t first = right >= kSlopePoints ? right - kSlopePoints + 1 : 1;
  const std::size_t last = std::min(values.size(), right + kSlopePoints);
  for (std::size_t i = first; i < last; ++i) {
    if (is_jump(values, i, jump)) return false;
  }
  return true;
}

/// Across a gap: the cubic with the values and slopes of both ends; a straight line would cut a sine's corner.
double across_gap(const std::vector<double>& time, const std::vector<double>& values, std::size_t right,
                  double weight) {
  const double length = time[right] - time[right - 1];
  const double a = values[right - 1], rise = values[right] - a;
  const double from = length * end_slope(time, values, right - 1, 1);
  const double to = length * end_slope(time, values, right, -1);
  return a + weight * (from + weight * (3 * rise - 2 * from - to + weight * (from + to - 2 * rise)));
}

/// Rows as they were logged, at their own stamps, and the grid that they are read on.
struct Rows {
  const std::vector<double>& time;
  const std::vector<double>& values;
  const UniformGrid& grid;
  double jump;  ///< least rise of a jump
  double snap;  ///< of a period: a grid sample so close to a row is that row

  bool is_at(double t, std::size_t i) const { return std::abs(time[i] - t) <= snap * grid.period_s; }

  bool is_jump_to(std::size_t i) const { return is_jump(values, i, jump); }
  bool is_gap_to(std::size_t i) const { return grid.is_gap_to(i); }
  /// Straight between rows, held until a jump.
  double at(double t, std::size_t right) const {
    const double weight = std::clamp((t - time[right - 1]) / (time[right] - time[right - 1]), 0.0, 1.0);
    if (weight == 1) return values[right];
    if (is_jump_to(right)) return values[right - 1];
    return values[right - 1] + weight * (values[right] - values[right - 1]);
  }
};

/// Calls read(k, t, right) for every grid sample k, its instant t, and the first row at or behind t (at least 1).
template <typename Read>
void each_grid_sample(const Rows& rows, Read read) {
  std::size_t right = 1;
  for (std::size_t k = 0; k < rows.grid.size; ++k) {
    double t = rows.grid.start_s + static_cast<double>(k) * rows.grid.period_s;
    while (right + 1 < rows.time.size() && rows.time[right] < t && !rows.is_at(t, right)) ++right;
    for (const std::size_t i : {right - 1, right}) {
      if (rows.is_at(t, i)) t = rows.time[i];
    }
    read(k, t, right);
  }
}

/// Whether the two rows before `right` and the two from it on are neighbours on one curve.
bool is_curve_around(const Rows& rows, std::size_t right) {
  if (right < 2 || right + 1 >= rows.time.size()) return false;
  for (std::size_t i = right - 1; i <= right + 1; ++i) {
    const bool is_short = rows.time[i] - rows.time[i - 1] < kShortInterval * rows.grid.period_s;
    if (is_short || rows.is_gap_to(i) || rows.is_jump_to(i)) return false;
  }
  return true;
}

/// The cubic through the four rows around t (Lagrange). What stands still stays as it is, to the last bit.
double on_cubic(const Rows& rows, double t, std::size_t right) {
  const double at = rows.values[right];
  double above = 0;
  for (std::size_t i = right - 2; i <= right + 1; ++i) {
    double weight = 1;
    for (std::size_t j = right - 2; j <= right + 1; ++j) {
      if (j != i) weight *= (t - rows.time[j]) / (rows.time[i] - rows.time[j]);
    }
    above += weight * (rows.values[i] - at);
  }
  return at + above;
}

/// A signal that was measured at the rows, on the grid. Straight lines would take off a curve what a lag of half a
/// period does, and half of the noise. Nothing leaves the range of the rows: where that is a limit, it is held.
std::vector<double> measured_on_grid(const Rows& rows) {
  const auto [low, high] = std::ranges::minmax(rows.values);
  std::vector<double> resampled(rows.grid.size);
  each_grid_sample(rows, [&](std::size_t k, double t, std::size_t right) {
    resampled[k] = is_curve_around(rows, right) ? std::clamp(on_cubic(rows, t, right), low, high) : rows.at(t, right);
  });
  return resampled;
}

/// ∫ of what the rows' lines lie above a line of the grid, from `left` to `left + rise`, over its interval, times the
/// hats of its two ends.
std::array<double, 2> areas_above(const Rows& rows, double from, std::size_t right, double left, double rise) {
  std::array<double, 2> areas{};
  const double to = from + rows.grid.period_s;
  for (double t = from; t < to; ++right) {
    const bool is_last = right + 1 >= rows.time.size() || rows.time[right] >= to;
    const double end = is_last ? to : rows.time[right];
    const double p = (t - from) / rows.grid.period_s, q = (end - from) / rows.grid.period_s, m = 0.5 * (p + q);
    const double a = rows.at(t, right) - left - p * rise, b = rows.at(end, right) - left - q * rise, c = 0.5 * (a + b);
    areas[0] += (q - p) / 6 * (a * (1 - p) + 4 * c * (1 - m) + b * (1 - q));  // Simpson is exact here
    areas[1] += (q - p) / 6 * (a * p + 4 * c * m + b * q);
    t = end;
  }
  return areas;
}

/// Makes grid samples [first, last] the knots of the lines nearest in the mean square to those between the rows: lines
/// through the rows' own values would cut every corner that lies inside an interval.
void project(const Rows& rows, std::size_t first, std::size_t last, std::span<const std::size_t> rights,
             std::vector<double>& knots) {
  const std::size_t n = last - first + 1;
  if (n < 3) return;
  std::vector<double> diagonal(n, 4.0 / 6), right(n, 0.0);
  diagonal.front() = diagonal.back() = 2.0 / 6;
  for (std::size_t i = 0; i + 1 < n; ++i) {
    const double from = rows.grid.start_s + static_cast<double>(first + i) * rows.grid.period_s;
    const double left = knots[first + i], rise = knots[first + i + 1] - left;
    const auto areas = areas_above(rows, from, rights[first + i], left, rise);
    right[i] += areas[0];
    right[i + 1] += areas[1];
  }
  constexpr double kBeside = 1.0 / 6;
  for (std::size_t i = 1; i < n; ++i) {
    const double share = kBeside / diagonal[i - 1];
    diagonal[i] -= share * kBeside;
    right[i] -= share * right[i - 1];
  }
  double above = 0;  // of what stands still: none, to the last bit
  for (std::size_t i = n; i-- > 0;) {
    above = (right[i] - (i + 1 < n ? kBeside * above : 0)) / diagonal[i];
    knots[first + i] += above;
  }
}

/// The input, which goes straight from row to row and is held until a jump, on the grid.
std::vector<double> commanded_on_grid(const Rows& rows, bool jitters) {
  std::vector<double> resampled(rows.grid.size);
  std::vector<std::size_t> rights(rows.grid.size);
  each_grid_sample(rows, [&](std::size_t k, double t, std::size_t right) {
    const bool bridges =
        rows.is_gap_to(right) && !rows.is_jump_to(right) && is_smooth_beside(rows.values, right, rows.jump);
    const double weight = std::clamp((t - rows.time[right - 1]) / (rows.time[right] - rows.time[right - 1]), 0.0, 1.0);
    resampled[k] = bridges ? across_gap(rows.time, rows.values, right, weight) : rows.at(t, right);
    rights[k] = right;
  });
  if (!jitters) return resampled;
  // Stretches without a jump or a gap.
  for (std::size_t first = 0, k = 1; k <= rows.grid.size; ++k) {
    bool ends = k == rows.grid.size;
    for (std::size_t row = rights[k - 1]; !ends && row <= rights[k]; ++row) {
      ends = rows.is_jump_to(row) || rows.is_gap_to(row);
    }
    if (!ends) continue;
    project(rows, first, k - 1, rights, resampled);
    first = k;
  }
  return resampled;
}

std::vector<InputJump> jumps_of(const Rows& rows) {
  const auto& [time, values, grid, least, snap] = rows;
  std::vector<InputJump> jumps;
  for (std::size_t i = 1; i < values.size(); ++i) {
    if (!is_jump(values, i, least)) continue;
    double at = (time[i] - grid.start_s) / grid.period_s;
    if (std::abs(at - std::round(at)) <= snap) at = std::round(at);
    const double interval = std::max(std::ceil(at) - 1, 0.0);
    if (interval + 1 >= static_cast<double>(grid.size)) continue;
    jumps.push_back({static_cast<std::size_t>(interval), std::clamp(at - interval, 0.0, 1.0), rows.is_gap_to(i)});
  }
  return jumps;
}

double range_of(const std::vector<double>& values) {
  const auto [low, high] = std::ranges::minmax(values);
  return high - low;
}

/// Noise of the rows, of which `gridded` is made; none where they are no smoother in their order than in time.
InputNoise noise_of_rows(const Rows& rows, const std::vector<double>& gridded) {
  if (!(white_noise(rows.values) < kSmootherByRows * white_noise(gridded))) return {};
  std::vector<std::size_t> begins{0};
  for (std::size_t i = 1; i < rows.values.size(); ++i) {
    if (rows.is_jump_to(i)) begins.push_back(i);
  }
  begins.push_back(rows.values.size());
  const std::vector<double> smooth = without_white_noise(rows.values, begins);
  InputNoise noise{.values = gridded, .left = white_noise(smooth)};
  const std::vector<double> without = commanded_on_grid({rows.time, smooth, rows.grid, rows.jump, rows.snap}, true);
  for (std::size_t k = 0; k < without.size(); ++k) noise.values[k] -= without[k];
  return noise;
}

}  // namespace

void resample(Recording& recording, const UniformGrid& grid, bool jitters) {
  const std::vector<double> logged = std::move(recording.input.values);
  const double snap = jitters ? kRounding : kJitterRatio;
  const Rows input{recording.time_s, logged, grid, kJumpRatio * range_of(logged), snap};
  recording.jumps = jumps_of(input);
  recording.input.values = commanded_on_grid(input, jitters);
  if (jitters) recording.input_noise = noise_of_rows(input, recording.input.values);
  const auto read = [&](std::vector<double>& values) {
    if (!values.empty())
      values = measured_on_grid({recording.time_s, values, grid, kJumpRatio * range_of(values), snap});
  };
  read(recording.output.values);
  for (Channel& side : recording.side) read(side.values);
}

}  // namespace valvetriage
