#include "core/analysis/known_tests.h"

#include <algorithm>
#include <bit>
#include <cmath>
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
constexpr double kBesideJumps = 0.02;  // of a recording's samples: those that a jump falls into
// A reference is read and written whole: no more digits than a stand's meters show.
constexpr double kInputSteps_per_a = 1e6, kResidualSteps_per_psi = 1e4;

std::vector<double> rounded(std::vector<double> values, double steps) {
  for (double& value : values) value = std::round(value * steps) / steps;
  return values;
}

/// How far two inputs may lie apart [A].
double tolerance_of(std::span<const double> input) {
  const Eigen::Map<const VectorXd> all(input.data(), std::ssize(input));
  const double deviation = std::sqrt((all.array() - all.mean()).square().mean());
  return std::max(kSameInput * deviation, kMeter * all.cwiseAbs().maxCoeff());
}

/// Squares of the differences of the inputs at samples that are valid, sample i of the recording beside i + shift of
/// the test; none where they share too few.
std::vector<double> squares_apart(const Recording& recording, std::span<const double> test, int shift) {
  const std::vector<double>& input = recording.input.values;
  const auto first = static_cast<std::size_t>(std::max(0, -shift));
  const auto end = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(std::ssize(test) - shift, 0, std::ssize(input)));
  std::vector<double> squares;
  if (end <= first || static_cast<double>(end - first) < kCovered * static_cast<double>(input.size())) return squares;
  squares.reserve(end - first);
  for (std::size_t i = first; i < end; ++i) {
    const double apart = input[i] - test[static_cast<std::size_t>(static_cast<std::ptrdiff_t>(i) + shift)];
    if (recording.is_valid(i)) squares.push_back(apart * apart);
  }
  return squares;
}

double mean_of(std::span<const double> values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

/// Where a recording stands in a test: its sample i is sample i + shift of that. None where it is of another.
std::optional<int> shift_into(const Recording& recording, double period_s, std::span<const double> test) {
  if (std::abs(recording.sample_period_s - period_s) > kSamePeriod * period_s) return std::nullopt;
  std::optional<int> closest;
  double least = std::numeric_limits<double>::infinity();
  for (int shift = -kMostShift; shift <= kMostShift; ++shift) {
    const std::vector<double> squares = squares_apart(recording, test, shift);
    if (squares.empty()) continue;
    const double mean = mean_of(squares);
    // The least shift of several that are as close.
    const bool is_closer = mean < least || (mean == least && std::abs(shift) < std::abs(*closest));
    if (!is_closer) continue;
    least = mean;
    closest = shift;
  }
  if (!closest) return std::nullopt;
  std::vector<double> squares = squares_apart(recording, test, *closest);
  const auto kept = static_cast<std::ptrdiff_t>(std::ceil((1 - kBesideJumps) * static_cast<double>(squares.size())));
  std::nth_element(squares.begin(), squares.begin() + kept - 1, squares.end());
  const double distance = std::sqrt(mean_of(std::span(squares).first(static_cast<std::size_t>(kept))));
  return distance <= tolerance_of(test) ? closest : std::nullopt;
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
VectorXd left_by(const FollowedValve& valve, const Recording& pattern, double& noise_square) {
  VectorXd sum = VectorXd::Zero(std::ssize(pattern.input.values)), known = sum;
  int recordings = 0;
  for (std::size_t r = 0; r < valve.recordings.size(); ++r) {
    const Recording& recording = valve.recordings[r];
    const auto shift = shift_into(recording, pattern.sample_period_s, pattern.input.values);
    if (!shift) continue;
    ++recordings;
    noise_square += std::pow(noise_floor(recording).rms, 2);
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      const auto there = static_cast<std::ptrdiff_t>(i) + *shift;
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
  for (const Recording& pattern : valves.front().recordings) {
    const bool is_known = std::any_of(tests_.begin(), tests_.end(), [&](const Test& test) {
      return shift_into(pattern, test.sample_period_s, test.input).has_value();
    });
    if (is_known) continue;
    MatrixXd left(static_cast<Index>(pattern.samples()), std::ssize(valves));
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
    tests_.push_back(
        {pattern.sample_period_s, rounded(pattern.input.values, kInputSteps_per_a), haar_of(left), noise_square});
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
  for (const KnownTest& test : tests) {
    const auto shift = shift_into(recording, test.sample_period_s, test.input);
    if (!shift) continue;
    std::vector<double> left(recording.samples());
    for (std::size_t i = 0; i < left.size(); ++i) {
      const auto there = static_cast<std::ptrdiff_t>(i) + *shift;
      if (there >= 0 && there < std::ssize(test.residual)) left[i] = test.residual[static_cast<std::size_t>(there)];
    }
    return left;
  }
  return {};
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

void put_back(std::span<const std::vector<double>> common, std::vector<std::vector<double>>& runs) {
  for (std::size_t r = 0; r < std::min(common.size(), runs.size()); ++r) {
    std::transform(common[r].begin(), common[r].end(), runs[r].begin(), runs[r].begin(), std::plus<>());
  }
}

}  // namespace valvetriage
