#include "core/recording/white_noise.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace valvetriage {
namespace {

constexpr double kIntervalInDeviations = 2.5;
// A parabola's error grows with the fourth power of its window: less of it is let in.
constexpr double kCurveIntervalInDeviations = 2;
constexpr double kLeastNoise = 1e-7;  // of the input's range: a clean log's own rounding
constexpr std::array<std::size_t, 7> kHalfWindows{1, 2, 4, 8, 16, 32, 64};
constexpr std::array<std::size_t, 11> kHalfCurves{2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64};

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

std::vector<double> without_white_noise(std::span<const double> signal, std::span<const std::size_t> begins) {
  std::vector<double> u(signal.begin(), signal.end());
  const double noise = white_noise(u);
  const auto [low, high] = std::minmax_element(u.begin(), u.end());
  if (!(noise > kLeastNoise * (*high - *low))) return u;
  // Sums about the first value keep their digits.
  std::vector<double> sums(u.size() + 1, 0.0);
  for (std::size_t i = 0; i < u.size(); ++i) sums[i + 1] = sums[i] + (u[i] - u[0]);
  std::vector<double> centred = u;
  for (double& value : centred) value -= u[0];
  const std::vector<Parabola> parabolas(kHalfCurves.begin(), kHalfCurves.end());
  for (std::size_t s = 0; s + 1 < begins.size(); ++s) {
    for (std::size_t i = begins[s]; i < begins[s + 1]; ++i) {
      const Estimate mean = agreeing_mean(sums, centred, i, begins[s], begins[s + 1], noise);
      const bool is_settled = mean.deviation < parabolas.back().deviation;
      const Estimate curve = is_settled ? mean : agreeing_curve(parabolas, centred, i, begins[s], begins[s + 1], noise);
      u[i] = signal[0] + (curve.deviation < mean.deviation ? curve.value : mean.value);
    }
  }
  return u;
}

}  // namespace valvetriage
