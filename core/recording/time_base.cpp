#include "core/recording/time_base.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/statistics/univariate_statistics.hpp>
#include <cmath>
#include <limits>

#include "core/recording/limits.h"
#include "core/recording/resample.h"

namespace valvetriage {
namespace {

constexpr double kGapRatio = 1.5;  ///< an interval above this many periods holds a missing sample
// Rows on either side that tell whether it does where a clock jitters: by half a period at most, a fifth in rms, the
// difference of two medians of nine is off by an eighth.
constexpr std::size_t kBesideGap = 9, kFewestBesideGap = 3;
constexpr double kIrregularShare = 0.25;  ///< of intervals far from the median: no sampling rate to speak of
constexpr double kMostMissing = 0.5;      ///< of the grid

std::vector<double> intervals_of(const std::vector<double>& time) {
  std::vector<double> intervals(time.size() - 1);
  for (std::size_t i = 0; i + 1 < time.size(); ++i) intervals[i] = time[i + 1] - time[i];
  return intervals;
}

Error time_error(std::string code, const Channel& time, std::string found, std::string expected) {
  Error error{.code = std::move(code)};
  error.field = time.name;
  error.message = fmt::format("{}: {}, expected {}", time.name, found, expected);
  error.found = std::move(found);
  error.expected = std::move(expected);
  return error;
}

double median_of(std::vector<double> values) {
  return boost::math::statistics::median(values);
}

/// Whether the stamps from `row` on are late for those before it by half a period or more: by the medians of what the
/// nearest rows on either side, from `from` on and before `to`, foretell of the two stamps.
bool are_rows_missing(const std::vector<double>& time, std::size_t row, std::size_t from, std::size_t to,
                      double period_s) {
  std::vector<double> last, next;
  for (std::size_t k = 0; k < std::min(kBesideGap, row - from); ++k) {
    last.push_back(time[row - 1 - k] + static_cast<double>(k) * period_s);
  }
  for (std::size_t k = 0; k < std::min(kBesideGap, to - row); ++k) {
    next.push_back(time[row + k] - static_cast<double>(k) * period_s);
  }
  const double late_s = median_of(std::move(next)) - median_of(std::move(last)) - period_s;
  return late_s > (kGapRatio - 1) * period_s;
}

/// Rows, ascending, ahead of which rows are missing. A clock that jitters makes some intervals long and the ones beside
/// them short; behind a missing row all rows are late. A gap among the rows that are asked makes a long interval beside
/// it look like one: it is asked again between the gaps that were found, where rows enough are left.
std::vector<std::size_t> gaps_in(const std::vector<double>& time, double period_s) {
  std::vector<std::size_t> found;
  for (std::size_t row = 1; row < time.size(); ++row) {
    const bool is_long = time[row] - time[row - 1] > kGapRatio * period_s;
    if (is_long && are_rows_missing(time, row, 0, time.size(), period_s)) found.push_back(row);
  }
  std::vector<std::size_t> gaps;
  for (std::size_t g = 0; g < found.size(); ++g) {
    const std::size_t row = found[g];
    const std::size_t from = g > 0 ? found[g - 1] : 0, to = g + 1 < found.size() ? found[g + 1] : time.size();
    const bool tells = std::min(row - from, to - row) >= kFewestBesideGap;
    if (!tells || are_rows_missing(time, row, from, to, period_s)) gaps.push_back(row);
  }
  return gaps;
}

Result<UniformGrid> find_grid(const Channel& channel) {
  const std::vector<double>& time = channel.values;
  const std::vector<double> intervals = intervals_of(time);
  const double median = median_of(intervals);
  UniformGrid grid{.start_s = time.front(), .gaps = gaps_in(time, median)};
  double sum = 0;
  std::size_t counted = 0, irregular = 0;
  for (std::size_t i = 0; i < intervals.size(); ++i) {
    const double periods = intervals[i] / median;
    if (!grid.is_gap_to(i + 1)) {
      sum += intervals[i];
      ++counted;
    }
    if (std::abs(periods - 1.0) > kGapRatio - 1.0) ++irregular;
  }
  grid.period_s = sum / static_cast<double>(counted);
  const double periods = std::round((time.back() - time.front()) / grid.period_s);
  const auto rows = static_cast<double>(time.size());
  if (static_cast<double>(irregular) > kIrregularShare * rows) {
    return tl::unexpected(
        time_error("irregular_time", channel, fmt::format("{} irregular intervals", irregular), "samples at one rate"));
  }
  if (!(periods + 1 <= rows / kMostMissing)) {
    return tl::unexpected(time_error("irregular_time", channel,
                                     fmt::format("{} samples over {:.6g} s", time.size(), time.back() - time.front()),
                                     "less than half of the samples missing"));
  }
  grid.size = static_cast<std::size_t>(periods) + 1;
  return grid;
}

/// Whether the stamps are those of a uniform clock written with few digits: all intervals have one of two lengths.
bool are_rounded(const std::vector<double>& time, double period_s) {
  const std::vector<double> intervals = intervals_of(time);
  const double shortest = std::ranges::min(intervals);
  const double resolution = std::ranges::max(intervals) - shortest;
  if (resolution > 0.5 * period_s) return false;
  return std::ranges::all_of(intervals, [&](double interval) {
    const double above = interval - shortest;
    return std::min(above, resolution - above) < 0.01 * resolution;
  });
}

struct Deviations {
  std::size_t count = 0;  ///< stamps off the grid by more than kJitterRatio
  double worst_ratio = 0;
};

Deviations deviations_of(const std::vector<double>& time, const UniformGrid& grid) {
  Deviations found;
  for (const double stamp : time) {
    const double at = (stamp - grid.start_s) / grid.period_s;
    const double off = std::abs(at - std::round(at));
    found.worst_ratio = std::max(found.worst_ratio, off);
    if (off > kJitterRatio) ++found.count;
  }
  return found;
}

struct Gaps {
  std::size_t count = 0;
  double longest_s = 0;
  double first_s = 0;
  std::vector<std::uint8_t> valid;  ///< empty where there is none
  std::size_t missing = 0;
};

Gaps gaps_of(const std::vector<double>& time, const UniformGrid& grid) {
  Gaps gaps;
  for (const std::size_t row : grid.gaps) {
    const double length = time[row] - time[row - 1];
    if (gaps.count++ == 0) {
      gaps.first_s = time[row - 1];
      gaps.valid.assign(grid.size, 1);
    }
    gaps.longest_s = std::max(gaps.longest_s, length);
    // What lies inside is not known: held before a jump, on a straight line before anything else.
    const auto from =
        static_cast<std::size_t>(std::floor((time[row - 1] - grid.start_s) / grid.period_s + kJitterRatio)) + 1;
    const auto to = static_cast<std::size_t>(std::ceil((time[row] - grid.start_s) / grid.period_s - kJitterRatio));
    for (std::size_t k = from; k < std::min(to, grid.size); ++k) {
      gaps.valid[k] = 0;
      ++gaps.missing;
    }
  }
  return gaps;
}

Result<void> check_increasing(const Channel& time) {
  const auto at = std::ranges::adjacent_find(time.values, std::greater_equal{});
  if (at == time.values.end()) return {};
  return tl::unexpected(
      time_error("time_not_increasing", time, fmt::format("{} after {}", *(at + 1), *at), "a time that increases"));
}

Recording recording_of(RawRecording raw) {
  Recording recording;
  recording.name = std::move(raw.name);
  recording.metadata = std::move(raw.metadata);
  recording.time_s = std::move(raw.time.values);
  recording.input = std::move(raw.input);
  recording.output = std::move(raw.output);
  recording.side = std::move(raw.side);
  return recording;
}

void take_sample_rate(Recording& recording, double sample_rate_hz) {
  recording.sample_period_s = 1.0 / sample_rate_hz;
  recording.time_s.resize(recording.samples());
  for (std::size_t i = 0; i < recording.samples(); ++i) recording.time_s[i] = static_cast<double>(i) / sample_rate_hz;
}

}  // namespace

Result<Recording> to_uniform_time(RawRecording raw, std::optional<double> sample_rate_hz) {
  if (raw.time.values.empty()) {
    Recording recording = recording_of(std::move(raw));
    take_sample_rate(recording, sample_rate_hz.value_or(1.0));
    return recording;
  }
  if (auto increasing = check_increasing(raw.time); !increasing) return tl::unexpected(increasing.error());
  const auto grid = find_grid(raw.time);
  if (!grid) return tl::unexpected(grid.error());

  Recording recording = recording_of(std::move(raw));
  recording.start_s = grid->start_s;
  recording.sample_period_s = grid->period_s;
  const Deviations jitter = deviations_of(recording.time_s, *grid);
  Gaps gaps = gaps_of(recording.time_s, *grid);
  const bool jitters = jitter.count > 0 && !(gaps.count == 0 && are_rounded(recording.time_s, grid->period_s));
  if (jitters) {
    recording.quality.push_back(
        {.code = "jitter",
         .detail = fmt::format("stamps up to {:.0f} % of the sampling period off a uniform grid; "
                               "resampled at {:.6g} Hz",
                               100 * jitter.worst_ratio, 1 / grid->period_s),
         .count = jitter.count});
  }
  if (gaps.count > 0) {
    recording.quality.push_back(
        {.code = "gap",
         .detail = fmt::format("{} gap{}, the longest {:.6g} s, the first after {:.6g} s", gaps.count,
                               gaps.count == 1 ? "" : "s", gaps.longest_s, gaps.first_s),
         .count = gaps.missing});
  }
  if (jitters || gaps.count > 0) resample(recording, *grid, jitters);
  recording.valid = std::move(gaps.valid);
  return recording;
}

}  // namespace valvetriage
