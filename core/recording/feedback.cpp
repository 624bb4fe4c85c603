#include "core/recording/feedback.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

constexpr std::size_t kPast = 6;  // increments of the input
constexpr int kOutputs = 3;
constexpr int kOwn = 1 + static_cast<int>(kPast);
constexpr int kAll = kOutputs + kOwn;
constexpr double kFewestRows = 50;
constexpr double kDrawn = 1e-6;    // of the squares: what is left of a drawn command
constexpr double kFromBefore = 2;  // times the squares that the present output alone must leave
constexpr double kRidge = 1e-12;

using Gram = Eigen::Matrix<double, kAll + 1, kAll + 1>;
using Row = Eigen::Matrix<double, kAll + 1, 1>;

/// Samples near the edges of commanded steps.
std::vector<std::uint8_t> commanded(const Recording& recording) {
  constexpr std::size_t kBefore = 3, kAfter = 6;
  std::vector<std::uint8_t> at(recording.samples(), 0);
  for (const Segment& segment : recording.segments) {
    if (!segment.begins_with_jump()) continue;
    const std::size_t from = segment.begin - std::min(segment.begin, kBefore);
    const std::size_t to = std::min(segment.begin + kAfter, at.size());
    for (std::size_t i = from; i < to; ++i) at[i] = 1;
  }
  return at;
}

/// Covariances of the present and two past outputs, the input before and its past increments, and its increment; the
/// latter's is 0 where there are too few samples.
Gram covariances_of(const Recording& recording) {
  const std::vector<double>& u = recording.input.values;
  const std::vector<double>& y = recording.output.values;
  const std::vector<std::uint8_t> left_out = commanded(recording);
  Gram sums = Gram::Zero();
  Row total = Row::Zero(), row;
  double rows = 0;
  for (std::size_t t = kPast + 1; t < u.size(); ++t) {
    if (left_out[t] != 0 || !recording.is_valid(t) || !recording.is_valid(t - 1) || !recording.is_valid(t - 2))
      continue;
    for (std::size_t k = 0; k < kOutputs; ++k) row[static_cast<int>(k)] = y[t - k] - y.front();
    row[kOutputs] = u[t - 1] - u.front();
    for (std::size_t k = 1; k <= kPast; ++k) row[kOutputs + static_cast<int>(k)] = u[t - k] - u[t - k - 1];
    row[kAll] = u[t] - u[t - 1];
    sums.noalias() += row * row.transpose();
    total += row;
    rows += 1;
  }
  if (rows < kFewestRows) return Gram::Zero();
  return sums - total * total.transpose() / rows;
}

/// Share of the increment's variance that the regressors tell.
double explained(const Gram& gram, const std::vector<int>& regressors) {
  Eigen::MatrixXd normal = gram(regressors, regressors);
  normal.diagonal() *= 1 + kRidge;
  const Eigen::VectorXd right = gram(regressors, std::vector<int>{kAll});
  const double share = right.dot(solve_symmetric(normal, right)) / gram(kAll, kAll);
  return std::isfinite(share) ? std::clamp(share, 0.0, 1.0) : 0;
}

std::vector<int> range(int from, int to) {
  std::vector<int> values;
  for (int i = from; i < to; ++i) values.push_back(i);
  return values;
}

}  // namespace

OutputFollowed output_followed(const Recording& recording) {
  const Gram gram = covariances_of(recording);
  if (!(gram(kAll, kAll) > 0)) return {};
  std::vector<int> own_and_present = range(kOutputs, kAll);
  const double by_own = explained(gram, own_and_present);
  own_and_present.push_back(0);
  const double left_by_own = 1 - by_own, left_by_all = 1 - explained(gram, range(0, kAll));
  const double left_by_present = 1 - explained(gram, own_and_present);
  OutputFollowed followed{.of_all = explained(gram, range(0, kOutputs))};
  if (left_by_own > kDrawn && left_by_present >= kFromBefore * left_by_all) {
    followed.beyond_past = 1 - left_by_all / left_by_own;
  }
  return followed;
}

}  // namespace valvetriage
