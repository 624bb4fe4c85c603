#include "core/analysis/known_tests.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <numbers>

#include "core/residual/noise_floor.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSameInput = 0.02;    // of its standard deviation
constexpr double kMeter = 0.003;       // of the largest current: what a meter of it is uncertain by
constexpr double kSamePeriod = 1e-3;   // of the sampling period
constexpr double kCovered = 0.95;      // of a recording's samples, by the test it is of
constexpr double kSameMovement = 0.5;  // of the larger deviation, by which two may differ
constexpr double kJump = 5;            // tolerances in one sample
constexpr double kClearlyCloser = 0.9;
// A reference is read and written whole: no more digits than a stand's meters show.
constexpr double kInputSteps_per_a = 1e6, kResidualSteps_per_psi = 1e4;

std::vector<double> rounded(std::vector<double> values, double steps) {
  for (double& value : values) value = std::round(value * steps) / steps;
  return values;
}

double deviation_of(std::span<const double> input) {
  if (input.empty()) return 0;
  const Eigen::Map<const VectorXd> all(input.data(), std::ssize(input));
  return std::sqrt((all.array() - all.mean()).square().mean());
}

std::vector<double> valid_input(const Recording& recording) {
  std::vector<double> input;
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    if (recording.is_valid(i)) input.push_back(recording.input.values[i]);
  }
  return input;
}

/// How an input moves [A].
struct Movement {
  double deviation = 0;
  double tolerance = 0;               ///< by which another may lie apart from it
  std::vector<std::uint8_t> is_jump;  ///< samples that a jump may fall into, a meter's sample sooner or later
};

Movement movement_of(std::span<const double> input) {
  const Eigen::Map<const VectorXd> all(input.data(), std::ssize(input));
  Movement movement{
      .deviation = deviation_of(input), .tolerance = 0, .is_jump = std::vector<std::uint8_t>(input.size())};
  movement.tolerance = std::max(kSameInput * movement.deviation, kMeter * all.cwiseAbs().maxCoeff());
  for (std::size_t i = 1; i < input.size(); ++i) {
    if (std::abs(input[i] - input[i - 1]) <= kJump * movement.tolerance) continue;
    for (std::size_t j = i - 1; j < std::min(i + 2, input.size()); ++j) movement.is_jump[j] = 1;
  }
  return movement;
}

/// Of an input beside a test's, sample i beside sample i + shift of that, where the recording is valid.
struct Apart {
  double mean_square = std::numeric_limits<double>::infinity();
  double beside_jumps = std::numeric_limits<double>::infinity();  ///< the same without samples that a jump falls into
};

Apart apart_at(const Recording& recording, std::span<const double> test, const Movement& movement, int shift) {
  const std::vector<double>& input = recording.input.values;
  const auto first = static_cast<std::size_t>(std::max(0, -shift));
  const auto end = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(std::ssize(test) - shift, 0, std::ssize(input)));
  if (end <= first || static_cast<double>(end - first) < kCovered * static_cast<double>(input.size())) return {};
  double all = 0, still = 0, of_all = 0, of_still = 0;
  for (std::size_t i = first; i < end; ++i) {
    if (!recording.is_valid(i)) continue;
    const auto there = static_cast<std::size_t>(static_cast<std::ptrdiff_t>(i) + shift);
    const double square = std::pow(input[i] - test[there], 2);
    all += square;
    ++of_all;
    if (movement.is_jump[there]) continue;
    still += square;
    ++of_still;
  }
  // An input that is all jumps is told by them.
  if (2 * of_still < of_all) return {all / of_all, all / of_all};
  return of_all > 0 ? Apart{all / of_all, still / of_still} : Apart{};
}

/// Where a recording stands in a test: its sample i is sample i + shift of that.
struct Place {
  int shift = 0;
  double mean_square = 0;  ///< of what the inputs lie apart
};

/// None where it is of another test.
std::optional<Place> place_in(const Recording& recording, const KnownTest& test) {
  if (std::abs(recording.sample_period_s - test.sample_period_s) > kSamePeriod * test.sample_period_s) {
    return std::nullopt;
  }
  const Movement movement = movement_of(test.input);
  const double own = deviation_of(valid_input(recording));
  if (std::abs(own - movement.deviation) > kSameMovement * std::max(own, movement.deviation)) return std::nullopt;
  Place place;
  Apart closest;
  // The least shift of several that are as good as the best: a hold has none.
  for (int k = 0; k <= 2 * kMostShift; ++k) {
    const int shift = k % 2 == 0 ? k / 2 : -(k + 1) / 2;
    const Apart apart = apart_at(recording, test.input, movement, shift);
    if (!(apart.mean_square < kClearlyCloser * closest.mean_square)) continue;
    closest = apart;
    place = {shift, apart.mean_square};
  }
  const bool is_same = closest.beside_jumps <= movement.tolerance * movement.tolerance;
  return is_same ? std::optional(place) : std::nullopt;
}

/// Orthonormal Haar transform in place, and back: a power of two of samples, the mean first, then from coarse to fine.
void to_haar(VectorXd& x) {
  for (Index n = x.size(); n > 1; n /= 2) {
    const VectorXd even = x.head(n)(Eigen::seq(0, n - 2, 2)), odd = x.head(n)(Eigen::seq(1, n - 1, 2));
    x.head(n / 2) = (even + odd) / std::numbers::sqrt2;
    x.segment(n / 2, n / 2) = (even - odd) / std::numbers::sqrt2;
  }
}

void from_haar(VectorXd& x) {
  for (Index n = 2; n <= x.size(); n *= 2) {
    const VectorXd sum = x.head(n / 2), difference = x.segment(n / 2, n / 2);
    x.head(n)(Eigen::seq(0, n - 2, 2)) = (sum + difference) / std::numbers::sqrt2;
    x.head(n)(Eigen::seq(1, n - 1, 2)) = (sum - difference) / std::numbers::sqrt2;
  }
}

/// Columns, in Haar coefficients. Where a valve has no number it is taken to leave what the others do.
MatrixXd haar_of(const MatrixXd& left) {
  const auto padded = static_cast<Index>(std::bit_ceil(static_cast<std::size_t>(left.rows())));
  MatrixXd coefficients = MatrixXd::Zero(padded, left.cols());
  for (Index i = 0; i < left.rows(); ++i) {
    double sum = 0, known = 0;
    for (const double value : left.row(i)) {
      if (!std::isfinite(value)) continue;
      sum += value;
      ++known;
    }
    for (Index v = 0; v < left.cols(); ++v) {
      coefficients(i, v) = std::isfinite(left(i, v)) ? left(i, v) : known > 0 ? sum / known : 0;
    }
  }
  for (Index v = 0; v < left.cols(); ++v) {
    VectorXd column = coefficients.col(v);
    to_haar(column);
    coefficients.col(v) = column;
  }
  return coefficients;
}

/// What a valve leaves of a test, the mean of its recordings of it; without a number where none is valid. Empty where
/// it was not put through it.
VectorXd left_by(const FollowedValve& valve, const KnownTest& pattern, double& noise_square) {
  VectorXd sum = VectorXd::Zero(std::ssize(pattern.input)), known = sum;
  int recordings = 0;
  for (std::size_t r = 0; r < valve.recordings.size(); ++r) {
    const Recording& recording = valve.recordings[r];
    const auto place = place_in(recording, pattern);
    if (!place) continue;
    ++recordings;
    noise_square += std::pow(noise_floor(recording).rms, 2);
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      const auto there = static_cast<std::ptrdiff_t>(i) + place->shift;
      if (there < 0 || there >= sum.size() || !recording.is_valid(i)) continue;
      sum(there) += recording.output.values[i] - valve.simulated[r][i];
      known(there) += 1;
    }
  }
  if (recordings == 0) return {};
  noise_square /= recordings;
  return sum.cwiseQuotient(known);  // 0 / 0: no number
}

/// The mean over columns, as far as it stands out.
VectorXd mean_that_stands_out(const MatrixXd& coefficients, double noise_square) {
  const double n = static_cast<double>(coefficients.cols());
  VectorXd mean = coefficients.rowwise().mean();
  const VectorXd scatter = (coefficients.colwise() - mean).rowwise().squaredNorm() / (n - 1);
  const double largest_by_chance = 2 * std::log(static_cast<double>(mean.size()));
  for (Index i = 0; i < mean.size(); ++i) {
    const double variance = std::max(scatter(i), noise_square) / n;
    const double square = mean(i) * mean(i);
    mean(i) = square > largest_by_chance * variance ? mean(i) * (1 - variance / square) : 0;
  }
  from_haar(mean);
  return mean;
}

}  // namespace

CommonResiduals::CommonResiduals(std::span<const FollowedValve> valves) {
  if (valves.size() < 2) return;
  for (const Recording& recording : valves.front().recordings) {
    const KnownTest pattern{recording.sample_period_s, rounded(recording.input.values, kInputSteps_per_a), {}};
    const bool is_known = std::any_of(tests_.begin(), tests_.end(), [&](const Test& test) {
      return place_in(recording, {test.sample_period_s, test.input, {}}).has_value();
    });
    if (is_known) continue;
    MatrixXd left(std::ssize(pattern.input), std::ssize(valves));
    double noise_square = 0;
    std::size_t played = 0;
    for (; played < valves.size(); ++played) {
      double of_valve = 0;
      const VectorXd column = left_by(valves[played], pattern, of_valve);
      if (column.size() == 0) break;
      left.col(static_cast<Index>(played)) = column;
      noise_square += of_valve / static_cast<double>(valves.size());
    }
    if (played < valves.size()) continue;
    tests_.push_back({pattern.sample_period_s, pattern.input, haar_of(left), noise_square});
  }
}

std::vector<KnownTest> CommonResiduals::without(std::optional<std::size_t> valve) const {
  std::vector<KnownTest> known;
  for (const Test& test : tests_) {
    MatrixXd others = test.coefficients;
    if (valve) {
      const Index last = others.cols() - 1;
      others.col(static_cast<Index>(*valve)) = others.col(last);
      others.conservativeResize(Eigen::NoChange, last);
    }
    if (others.cols() < 2) continue;
    const VectorXd mean = mean_that_stands_out(others, test.noise_square);
    const std::vector<double> residual(mean.data(), mean.data() + test.input.size());
    known.push_back({test.sample_period_s, test.input, rounded(residual, kResidualSteps_per_psi)});
  }
  return known;
}

std::vector<double> left_in_common(const Recording& recording, std::span<const KnownTest> tests) {
  if (tests.empty()) return {};
  std::vector<double> left(recording.samples());
  // Of a reading that never moves, or of none, nothing is a valve's.
  const double digit = smallest_step(recording);
  if (digit == 0) return left;
  const KnownTest* closest = nullptr;
  Place place;
  for (const KnownTest& test : tests) {
    const auto here = place_in(recording, test);
    if (!here || (closest && place.mean_square <= here->mean_square)) continue;
    closest = &test;
    place = *here;
  }
  if (!closest) return {};
  const auto last = std::ssize(closest->residual) - 1;
  for (std::size_t i = 0; i < left.size(); ++i) {
    const auto there = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(i) + place.shift, 0, last);
    // To the reading's own digits: what is left of it stays as coarse as it was.
    left[i] = std::round(closest->residual[static_cast<std::size_t>(there)] / digit) * digit;
  }
  return left;
}

std::optional<std::vector<std::vector<double>>> all_left_in_common(std::span<const Recording> recordings,
                                                                   std::span<const KnownTest> tests) {
  std::vector<std::vector<double>> common;
  for (const Recording& recording : recordings) {
    common.push_back(left_in_common(recording, tests));
    if (common.back().empty()) return std::nullopt;
  }
  return common;
}

void take_off(std::span<const double> common, Recording& recording) {
  std::vector<double>& output = recording.output.values;
  std::transform(common.begin(), common.end(), output.begin(), output.begin(),
                 [](double usual, double measured) { return measured - usual; });
}

void put_back(std::span<const double> common, std::vector<double>& run) {
  std::transform(common.begin(), common.end(), run.begin(), run.begin(), std::plus<>());
}

}  // namespace valvetriage
