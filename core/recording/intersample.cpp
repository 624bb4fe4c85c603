#include "core/recording/intersample.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace valvetriage {
namespace {

// A straight line through a gap is trusted where the slopes on both sides bend it by less than this part of the range.
constexpr double kBend = 0.002;
constexpr std::size_t kBeside = 5;

/// How far a cubic through the samples beside [first, last) lies from the straight line, at its middle.
double bend_across(const std::vector<double>& u, std::size_t first, std::size_t last) {
  if (first < kBeside || last + kBeside > u.size()) return 0;
  const auto slope = [&](std::size_t from) {
    return (u[from + kBeside - 1] - u[from]) / static_cast<double>(kBeside - 1);
  };
  return static_cast<double>(last - first + 1) / 8 * std::abs(slope(last) - slope(first - kBeside));
}

constexpr double kIntervalInDeviations = 2.5;
// A parabola's error grows with the fourth power of its window: less of it is let in.
constexpr double kCurveIntervalInDeviations = 2;
constexpr double kLeastNoise = 1e-7;  // of the input's range: a clean log's own rounding
constexpr std::array<std::size_t, 7> kHalfWindows{1, 2, 4, 8, 16, 32, 64};
constexpr std::array<std::size_t, 11> kHalfCurves{2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64};

/// Samples that begin a new stretch: no window reaches across them.
std::vector<std::size_t> stretches(const Recording& recording) {
  std::vector<std::size_t> begins{0, recording.samples()};
  for (const Segment& segment : recording.segments) {
    if (segment.kind == SegmentKind::kStep) begins.push_back(segment.begin);
  }
  for (const InputJump& jump : recording.jumps) begins.push_back(jump.interval + 1);
  std::sort(begins.begin(), begins.end());
  begins.erase(std::unique(begins.begin(), begins.end()), begins.end());
  return begins;
}

struct Estimate {
  double value = 0;
  double deviation = 0;  ///< of its error, in deviations of the noise
};

/// Estimates of one value, each more certain than the one before, as long as their intervals have a point in common.
class Agreement {
 public:
  /// reach  half of the interval of an estimate that errs by one deviation of the noise, unit of the signal
  Agreement(double sample, double reach)
      : reach_(reach), low_(sample - reach), high_(sample + reach), best_{sample, 1} {}

  /// False where it does not agree with those before.
  bool take(double value, double deviation) {
    low_ = std::max(low_, value - reach_ * deviation);
    high_ = std::min(high_, value + reach_ * deviation);
    if (low_ > high_) return false;
    best_ = {value, deviation};
    return true;
  }
  const Estimate& best() const { return best_; }

 private:
  double reach_, low_, high_;
  Estimate best_;
};

/// The mean over the widest window around sample i of [first, last) that agrees with all narrower ones.
Estimate agreeing_mean(std::span<const double> sums, std::span<const double> u, std::size_t i, std::size_t first,
                       std::size_t last, double noise) {
  Agreement means(u[i], kIntervalInDeviations * noise);
  for (const std::size_t half : kHalfWindows) {
    if (i < first + half || i + half >= last) break;
    const double count = static_cast<double>(2 * half + 1);
    if (!means.take((sums[i + half + 1] - sums[i - half]) / count, 1 / std::sqrt(count))) break;
  }
  return means.best();
}

/// Least squares of a parabola over 2 half + 1 samples: its middle is (Σj⁴ Σu − Σj² Σj²u) / determinant.
struct Parabola {
  explicit Parabola(std::size_t beside) : half(beside) {
    for (std::size_t j = 1; j <= half; ++j) {
      const double square = static_cast<double>(j * j);
      squares += 2 * square;
      fourths += 2 * square * square;
    }
    determinant = static_cast<double>(2 * half + 1) * fourths - squares * squares;
    deviation = std::sqrt(fourths / determinant);
  }
  double middle(std::span<const double> u, std::size_t i) const {
    double sum = u[i], weighted = 0;
    for (std::size_t j = 1; j <= half; ++j) {
      const double both = u[i - j] + u[i + j];
      sum += both;
      weighted += static_cast<double>(j * j) * both;
    }
    return (fourths * sum - squares * weighted) / determinant;
  }

  std::size_t half;
  double squares = 0, fourths = 0, determinant = 0;
  double deviation = 0;  ///< of the middle's error, in deviations of the noise
};

/// The same with the middles of parabolas.
Estimate agreeing_curve(std::span<const Parabola> parabolas, std::span<const double> u, std::size_t i,
                        std::size_t first, std::size_t last, double noise) {
  Agreement curves(u[i], kCurveIntervalInDeviations * noise);
  for (const Parabola& parabola : parabolas) {
    if (i < first + parabola.half || i + parabola.half >= last) break;
    if (!curves.take(parabola.middle(u, i), parabola.deviation)) break;
  }
  return curves.best();
}

std::vector<double> without_noise(const Recording& recording) {
  std::vector<double> u = recording.input.values;
  const double noise = white_noise(u);
  const auto [low, high] = std::minmax_element(u.begin(), u.end());
  if (!(noise > kLeastNoise * (*high - *low))) return u;
  // Sums about the first value keep their digits.
  std::vector<double> sums(u.size() + 1, 0.0);
  for (std::size_t i = 0; i < u.size(); ++i) sums[i + 1] = sums[i] + (u[i] - u[0]);
  std::vector<double> centred = u;
  for (double& value : centred) value -= u[0];
  const std::vector<Parabola> parabolas(kHalfCurves.begin(), kHalfCurves.end());
  const std::vector<std::size_t> begins = stretches(recording);
  for (std::size_t s = 0; s + 1 < begins.size(); ++s) {
    for (std::size_t i = begins[s]; i < begins[s + 1]; ++i) {
      const Estimate mean = agreeing_mean(sums, centred, i, begins[s], begins[s + 1], noise);
      const bool is_settled = mean.deviation < parabolas.back().deviation;
      const Estimate curve = is_settled ? mean : agreeing_curve(parabolas, centred, i, begins[s], begins[s + 1], noise);
      u[i] = recording.input.values[0] + (curve.deviation < mean.deviation ? curve.value : mean.value);
    }
  }
  return u;
}

IntervalSignal between_samples(const Recording& recording, const std::vector<double>& u) {
  IntervalSignal signal{u, u};
  for (std::size_t i = 0; i + 1 < u.size(); ++i) signal.end[i] = u[i + 1];
  for (const Segment& segment : recording.segments) {
    if (segment.kind == SegmentKind::kStep && segment.begin > 0) {
      signal.end[segment.begin - 1] = signal.start[segment.begin - 1];
    }
  }
  // A jump between two samples of the grid: held at the value that gives the interval its mean.
  for (const InputJump& jump : recording.jumps) {
    const double before = u[jump.interval], after = u[jump.interval + 1];
    signal.start[jump.interval] = signal.end[jump.interval] = before + (1 - jump.fraction) * (after - before);
  }
  return signal;
}

}  // namespace

double white_noise(std::span<const double> signal) {
  // Differences of a higher order take off faster signals; of noise each leaves √C(2k, k) times its deviation.
  constexpr std::array<std::pair<int, double>, 3> kOrders{{{3, 20}, {6, 924}, {9, 48620}}};
  constexpr double kQuartileOfNormal = 0.3186;  // of |z|
  std::vector<double> difference(signal.begin(), signal.end());
  double least = std::numeric_limits<double>::infinity();
  int taken = 0;
  for (const auto& [order, power] : kOrders) {
    if (signal.size() < static_cast<std::size_t>(order) + 5) break;
    for (; taken < order; ++taken) {
      for (std::size_t i = 0; i + 1 < difference.size(); ++i) difference[i] = difference[i + 1] - difference[i];
      difference.pop_back();
    }
    std::vector<double> size = difference;
    for (double& value : size) value = std::abs(value);
    const auto quartile = size.begin() + static_cast<std::ptrdiff_t>(size.size() / 4);
    std::nth_element(size.begin(), quartile, size.end());
    least = std::min(least, *quartile / kQuartileOfNormal / std::sqrt(power));
  }
  return std::isfinite(least) ? least : 0;
}

IntervalSignal input_between_samples(const Recording& recording) {
  return between_samples(recording, recording.input.values);
}

IntervalSignal noise_free_input(const Recording& recording) {
  return between_samples(recording, without_noise(recording));
}

std::size_t leave_out_lost_input(Recording& recording, double settling_s) {
  const std::vector<double>& u = recording.input.values;
  if (recording.valid.empty() || u.empty()) return 0;
  const auto [low, high] = std::minmax_element(u.begin(), u.end());
  const auto settling = static_cast<std::size_t>(std::ceil(settling_s / recording.sample_period_s));
  std::vector<std::size_t> until(u.size(), 0);  // of a gap that starts here
  for (std::size_t first = 0, last = 0; first < u.size(); first = last + 1) {
    while (first < u.size() && recording.valid[first] != 0) ++first;
    for (last = first; last < u.size() && recording.valid[last] == 0;) ++last;
    if (last < u.size() && bend_across(u, first, last) > kBend * (*high - *low)) until[first] = last + settling;
  }
  for (const InputJump& jump : recording.jumps) {
    if (jump.in_gap) until[jump.interval] = jump.interval + settling;
  }
  std::size_t left_out = 0;
  for (std::size_t i = 0, end = 0; i < u.size(); ++i) {
    end = std::max(end, until[i]);
    if (i >= end) continue;
    left_out += recording.valid[i];
    recording.valid[i] = 0;
  }
  return left_out;
}

}  // namespace valvetriage
