#include "core/residual/noise_floor.h"

#include <Eigen/Core>
#include <algorithm>
#include <boost/math/statistics/univariate_statistics.hpp>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

// A hold's settled part: its last 40 %, long enough that a line leaves a usable mean square.
constexpr double kSettledShare = 0.4;
constexpr std::size_t kFewestSettledSamples = 40;
// Of what is measured in a hold, both about their lines: nine tenths of its mean square are then noise.
constexpr double kStillMoving = 1.0 / 3;
constexpr std::size_t kFewestHolds = 4;
constexpr double kCorrelationTimes = 9;  // in a hold's settled part: then a line takes little of the noise
// Upper over lower quartile of the holds' mean squares: 2.5 for five independent samples in each, 3.4 for three.
constexpr double kStationarySpread = 4;
constexpr double kMadToSigma = 1.4826;  // of a normal distribution

bool is_stationary(std::vector<double> mean_squares) {
  if (mean_squares.size() < kFewestHolds) return false;
  std::sort(mean_squares.begin(), mean_squares.end());
  const std::size_t quarter = mean_squares.size() / 4;
  return mean_squares[mean_squares.size() - 1 - quarter] <= kStationarySpread * mean_squares[quarter];
}

struct HoldNoise {
  double mean_square = 0;
  std::size_t samples = 0;
};

/// Mean square of values about the straight line through the recording's valid samples of [begin, end).
HoldNoise about_line(std::span<const double> values, const Recording& recording, std::size_t begin, std::size_t end) {
  double n = 0, st = 0, sy = 0, stt = 0, sty = 0, syy = 0;
  const double middle = 0.5 * static_cast<double>(begin + end);
  const double origin = values[begin];
  for (std::size_t i = begin; i < end; ++i) {
    if (!recording.is_valid(i)) continue;
    const double t = static_cast<double>(i) - middle;
    const double y = values[i] - origin;
    n += 1;
    st += t;
    sy += y;
    stt += t * t;
    sty += t * y;
    syy += y * y;
  }
  if (n < static_cast<double>(kFewestSettledSamples)) return {};
  const double ctt = stt - st * st / n;
  const double cty = sty - st * sy / n;
  const double cyy = syy - sy * sy / n;
  const double left = std::max(0.0, cyy - cty * cty / ctt);
  return {left / (n - 2), static_cast<std::size_t>(n)};
}

double from_differences(const Recording& recording) {
  const auto& y = recording.output.values;
  std::vector<double> size;
  size.reserve(y.size());
  for (std::size_t i = 3; i < y.size(); ++i) {
    if (!recording.is_valid(i) || !recording.is_valid(i - 1) || !recording.is_valid(i - 2) ||
        !recording.is_valid(i - 3)) {
      continue;
    }
    size.push_back(std::abs(y[i] - 3 * y[i - 1] + 3 * y[i - 2] - y[i - 3]));
  }
  if (size.empty()) return 0;
  return kMadToSigma * boost::math::statistics::median(size) / std::sqrt(20.0);
}

/// Rms that a linear one-step prediction leaves; infinite where there are too few samples for it.
double from_prediction(const Recording& recording) {
  constexpr Eigen::Index kLags = 8;
  constexpr Eigen::Index kRegressors = 2 * kLags + 1;
  using Matrix = Eigen::Matrix<double, kRegressors + 1, kRegressors + 1>;
  const auto& y = recording.output.values;
  const auto& u = recording.input.values;
  const double origin_y = y.front(), origin_u = u.front();
  Matrix products = Matrix::Zero();
  Eigen::Matrix<double, kRegressors + 1, 1> row;
  double count = 0;
  for (std::size_t t = kLags; t < y.size(); ++t) {
    bool usable = true;
    for (Eigen::Index j = 0; j <= kLags; ++j) usable = usable && recording.is_valid(t - static_cast<std::size_t>(j));
    if (!usable) continue;
    for (Eigen::Index j = 0; j < kLags; ++j) {
      row(j) = y[t - 1 - static_cast<std::size_t>(j)] - origin_y;
      row(kLags + j) = u[t - static_cast<std::size_t>(j)] - origin_u;
    }
    row(kRegressors - 1) = 1;
    row(kRegressors) = y[t] - origin_y;
    products.selfadjointView<Eigen::Lower>().rankUpdate(row);
    count += 1;
  }
  if (count < 4.0 * kRegressors) return std::numeric_limits<double>::infinity();
  // Schur complement of the target: its squares less what the regressors explain.
  const Eigen::MatrixXd a = products.topLeftCorner<kRegressors, kRegressors>().selfadjointView<Eigen::Lower>();
  const Eigen::VectorXd b = products.bottomLeftCorner<1, kRegressors>().transpose();
  const double left = products(kRegressors, kRegressors) - b.dot(least_squares(a, b));
  return std::sqrt(std::max(0.0, left) / (count - kRegressors));
}

/// What the settled parts of holds show.
struct Holds {
  std::vector<double> mean_squares;
  std::size_t samples = 0;

  double rms() const {
    if (mean_squares.empty()) return std::numeric_limits<double>::infinity();
    std::vector<double> by_size = mean_squares;
    return std::sqrt(boost::math::statistics::median(by_size));
  }
};

/// Of all holds that are long enough; where a free run is given, of those in which it stands still.
Holds settled_holds(const Recording& recording, std::span<const double> simulated) {
  Holds holds;
  for (const Segment& segment : recording.segments) {
    if (segment.kind != SegmentKind::kHold && segment.kind != SegmentKind::kStep) continue;
    const std::size_t length = segment.end - segment.begin;
    const auto settled = static_cast<std::size_t>(kSettledShare * static_cast<double>(length));
    const std::size_t begin = segment.end - settled;
    const HoldNoise noise = about_line(recording.output.values, recording, begin, segment.end);
    if (noise.samples == 0) continue;
    if (!simulated.empty()) {
      const double moves = about_line(simulated, recording, begin, segment.end).mean_square;
      if (moves > kStillMoving * kStillMoving * noise.mean_square) continue;
    }
    holds.mean_squares.push_back(noise.mean_square);
    holds.samples += noise.samples;
  }
  return holds;
}

/// What neighbouring samples show.
NoiseFloor from_neighbours(const Recording& recording) {
  const double differences = from_differences(recording);
  const double prediction = from_prediction(recording);
  return {std::min(differences, prediction),
          prediction < differences ? NoiseFloorMethod::kPrediction : NoiseFloorMethod::kDifferences,
          recording.samples()};
}

NoiseFloor at_least_resolution(const Recording& recording, NoiseFloor floor) {
  floor.rms = std::max(floor.rms, smallest_step(recording) / std::sqrt(12.0));
  return floor;
}

}  // namespace

double smallest_step(const Recording& recording) {
  double smallest = std::numeric_limits<double>::infinity();
  std::optional<double> before;
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    if (!recording.is_valid(i)) continue;
    const double here = recording.output.values[i];
    if (before && here != *before) smallest = std::min(smallest, std::abs(here - *before));
    before = here;
  }
  return std::isfinite(smallest) ? smallest : 0;
}

NoiseFloor noise_floor(const Recording& recording) {
  const Holds holds = settled_holds(recording, {});
  if (holds.mean_squares.empty()) return at_least_resolution(recording, from_neighbours(recording));
  return at_least_resolution(recording, {holds.rms(), NoiseFloorMethod::kHolds, holds.samples});
}

NoiseFloor noise_floor_of_ringing(const Recording& recording, std::span<const double> simulated) {
  const Holds holds = settled_holds(recording, simulated);
  NoiseFloor floor = from_neighbours(recording);
  if (is_stationary(holds.mean_squares)) {
    // Noise whose memory of τ samples fits a hold's settled part kCorrelationTimes over is √(τ/2) times what it brings
    // anew with each sample, which is what a prediction leaves; a machine that rings brings nothing anew.
    const double settled = static_cast<double>(holds.samples) / static_cast<double>(holds.mean_squares.size());
    floor.rms *= std::max(1.0, std::sqrt(settled / kCorrelationTimes / 2));
  }
  if (holds.rms() < floor.rms) floor = {holds.rms(), NoiseFloorMethod::kHolds, holds.samples};
  return at_least_resolution(recording, floor);
}

}  // namespace valvetriage
