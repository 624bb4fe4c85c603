#include "core/analysis/known_tests.h"

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

#include "core/residual/noise_floor.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSameInput = 0.02;   // of its standard deviation
constexpr double kSamePeriod = 1e-3;  // of the sampling period
constexpr double kCovered = 0.95;     // of a recording's samples, by the test it is of
// A reference is read and written whole: no more digits than a stand's meters show.
constexpr double kInputSteps_per_a = 1e6, kResidualSteps_per_psi = 1e4;

std::vector<double> rounded(std::vector<double> values, double steps) {
  for (double& value : values) value = std::round(value * steps) / steps;
  return values;
}

/// Where a recording stands in a test: sample i of the one is sample i + shift of the other.
struct Place {
  int shift = 0;
  double distance = 0;  ///< rms of the difference of the inputs [A]
};

/// Of the samples that both have; none where they have too few in common.
std::optional<Place> place_at(std::span<const double> input, std::span<const double> test, int shift) {
  const auto first = static_cast<std::size_t>(std::max(0, -shift));
  const auto end = static_cast<std::size_t>(
      std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(test.size()) - shift, 0, std::ssize(input)));
  if (end <= first || static_cast<double>(end - first) < kCovered * static_cast<double>(input.size()))
    return std::nullopt;
  const Eigen::Map<const VectorXd> here(input.data() + first, static_cast<Index>(end - first));
  const Eigen::Map<const VectorXd> there(test.data() + static_cast<std::ptrdiff_t>(first) + shift,
                                         static_cast<Index>(end - first));
  return Place{shift, std::sqrt((here - there).squaredNorm() / static_cast<double>(here.size()))};
}

std::optional<Place> place_of(const Recording& recording, double period_s, std::span<const double> test) {
  if (std::abs(recording.sample_period_s - period_s) > kSamePeriod * period_s) return std::nullopt;
  const std::vector<double>& input = recording.input.values;
  std::optional<Place> closest;
  for (int shift = -kMostShift; shift <= kMostShift; ++shift) {
    const auto place = place_at(input, test, shift);
    if (place && (!closest || place->distance < closest->distance)) closest = place;
  }
  const Eigen::Map<const VectorXd> all(test.data(), std::ssize(test));
  const double deviation = std::sqrt((all.array() - all.mean()).square().mean());
  return closest && closest->distance <= kSameInput * deviation ? closest : std::nullopt;
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

/// The mean of what valves leave, one column each, as far as it stands out.
std::vector<double> mean_that_stands_out(MatrixXd left, double noise) {
  const auto samples = left.rows();
  const double n = static_cast<double>(left.cols());
  const auto padded = static_cast<Index>(std::bit_ceil(static_cast<std::size_t>(samples)));
  MatrixXd coefficients = MatrixXd::Zero(padded, left.cols());
  coefficients.topRows(samples) = left;
  for (Index v = 0; v < left.cols(); ++v) {
    VectorXd column = coefficients.col(v);
    to_haar(column);
    coefficients.col(v) = column;
  }
  VectorXd mean = coefficients.rowwise().mean();
  const VectorXd scatter = (coefficients.colwise() - mean).rowwise().squaredNorm() / (n - 1);
  const double largest_by_chance = 2 * std::log(static_cast<double>(samples));
  for (Index i = 0; i < padded; ++i) {
    const double variance = std::max(scatter(i), noise * noise) / n;
    const double square = mean(i) * mean(i);
    mean(i) = square > largest_by_chance * variance ? mean(i) * (1 - variance / square) : 0;
  }
  from_haar(mean);
  return {mean.data(), mean.data() + samples};
}

/// What a recording leaves, on the samples of the test it is of; none where it lost some.
void add_left(const Recording& recording, std::span<const double> simulated, int shift, Eigen::Ref<VectorXd> left) {
  for (std::size_t i = 0; i < simulated.size(); ++i) {
    const auto there = static_cast<std::ptrdiff_t>(i) + shift;
    if (there < 0 || there >= left.size() || !recording.is_valid(i)) continue;
    left(there) = recording.output.values[i] - simulated[i];
  }
}

}  // namespace

std::vector<KnownTest> known_tests(std::span<const FollowedValve> valves) {
  std::vector<KnownTest> tests;
  if (valves.size() < 2) return tests;
  for (const FollowedValve& valve : valves) {
    if (valve.recordings.size() != valves.front().recordings.size()) return {};
  }
  for (const Recording& pattern : valves.front().recordings) {
    MatrixXd left = MatrixXd::Zero(static_cast<Index>(pattern.samples()), std::ssize(valves));
    VectorXd input = VectorXd::Zero(left.rows());
    double noise_squares = 0;
    for (std::size_t v = 0; v < valves.size(); ++v) {
      const auto& recordings = valves[v].recordings;
      const Recording* same = nullptr;
      std::optional<Place> place;
      for (const Recording& recording : recordings) {
        const auto here = place_of(recording, pattern.sample_period_s, pattern.input.values);
        if (!here || (place && place->distance <= here->distance)) continue;
        place = here;
        same = &recording;
      }
      if (!same) return {};
      add_left(*same, valves[v].simulated[static_cast<std::size_t>(same - recordings.data())], place->shift,
               left.col(static_cast<Index>(v)));
      noise_squares += std::pow(noise_floor(*same).rms, 2) / static_cast<double>(valves.size());
    }
    tests.push_back({pattern.sample_period_s, rounded(pattern.input.values, kInputSteps_per_a),
                     rounded(mean_that_stands_out(std::move(left), std::sqrt(noise_squares)), kResidualSteps_per_psi)});
  }
  return tests;
}

std::optional<std::vector<std::vector<double>>> left_in_common(std::span<const Recording> recordings,
                                                               std::span<const KnownTest> tests) {
  std::vector<std::vector<double>> common;
  for (const Recording& recording : recordings) {
    const KnownTest* same = nullptr;
    std::optional<Place> place;
    for (const KnownTest& test : tests) {
      const auto here = place_of(recording, test.sample_period_s, test.input);
      if (!here || (place && place->distance <= here->distance)) continue;
      place = here;
      same = &test;
    }
    if (!same) return std::nullopt;
    std::vector<double>& left = common.emplace_back(recording.samples());
    for (std::size_t i = 0; i < left.size(); ++i) {
      const auto there = static_cast<std::ptrdiff_t>(i) + place->shift;
      if (there >= 0 && there < std::ssize(same->residual)) left[i] = same->residual[static_cast<std::size_t>(there)];
    }
  }
  return common;
}

void take_off(std::span<const std::vector<double>> common, std::vector<Recording>& recordings) {
  for (std::size_t r = 0; r < common.size(); ++r) {
    std::vector<double>& output = recordings[r].output.values;
    std::transform(output.begin(), output.end(), common[r].begin(), output.begin(), std::minus<>());
  }
}

void put_back(std::span<const std::vector<double>> common, std::vector<std::vector<double>>& runs) {
  for (std::size_t r = 0; r < std::min(common.size(), runs.size()); ++r) {
    std::transform(runs[r].begin(), runs[r].end(), common[r].begin(), runs[r].begin(), std::plus<>());
  }
}

}  // namespace valvetriage
