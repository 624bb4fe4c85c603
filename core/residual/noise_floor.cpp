#include "core/residual/noise_floor.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace valvetriage {
namespace {

// A hold's settled part: its last 40 %, long enough that a line leaves a usable mean square.
constexpr double kSettledShare = 0.4;
constexpr std::size_t kFewestSettledSamples = 40;
constexpr double kMadToSigma = 1.4826;  // of a normal distribution

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

struct HoldNoise {
  double mean_square = 0;
  std::size_t samples = 0;
};

/// Mean square about the straight line through valid samples of [begin, end).
HoldNoise noise_about_line(const Recording& recording, std::size_t begin, std::size_t end) {
  double n = 0, st = 0, sy = 0, stt = 0, sty = 0, syy = 0;
  const double middle = 0.5 * static_cast<double>(begin + end);
  const double origin = recording.output.values[begin];
  for (std::size_t i = begin; i < end; ++i) {
    if (!recording.is_valid(i)) continue;
    const double t = static_cast<double>(i) - middle;
    const double y = recording.output.values[i] - origin;
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

double smallest_step(const Recording& recording) {
  double smallest = std::numeric_limits<double>::infinity();
  const auto& y = recording.output.values;
  for (std::size_t i = 1; i < y.size(); ++i) {
    const double step = std::abs(y[i] - y[i - 1]);
    if (step > 0) smallest = std::min(smallest, step);
  }
  return std::isfinite(smallest) ? smallest : 0;
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
  return kMadToSigma * median_of(size) / std::sqrt(20.0);
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
  const double left = products(kRegressors, kRegressors) - b.dot(a.completeOrthogonalDecomposition().solve(b));
  return std::sqrt(std::max(0.0, left) / (count - kRegressors));
}

}  // namespace

NoiseFloor noise_floor(const Recording& recording) {
  NoiseFloor floor;
  std::vector<double> mean_squares;
  for (const Segment& segment : recording.segments) {
    if (segment.kind != SegmentKind::kHold && segment.kind != SegmentKind::kStep) continue;
    const std::size_t length = segment.end - segment.begin;
    const auto settled = static_cast<std::size_t>(kSettledShare * static_cast<double>(length));
    const HoldNoise noise = noise_about_line(recording, segment.end - settled, segment.end);
    if (noise.samples == 0) continue;
    mean_squares.push_back(noise.mean_square);
    floor.samples += noise.samples;
  }
  const double resolution = smallest_step(recording) / std::sqrt(12.0);
  if (!mean_squares.empty()) {
    floor.method = NoiseFloorMethod::kHolds;
    floor.rms = std::max(std::sqrt(median_of(mean_squares)), resolution);
    return floor;
  }
  const double differences = from_differences(recording);
  const double prediction = from_prediction(recording);
  floor.method = prediction < differences ? NoiseFloorMethod::kPrediction : NoiseFloorMethod::kDifferences;
  floor.samples = recording.samples();
  floor.rms = std::max(std::min(differences, prediction), resolution);
  return floor;
}

}  // namespace valvetriage
