#include "core/analysis/population_covariance.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Over which a map's local shifts are alike in valves that are played over 1 A or more: no less than knots can show, no
// more than makes one shift of all.
constexpr double kShortest_a = 0.05, kTypical_a = 0.15, kLongest_a = 1;
// A parameter that happens to agree between a few valves is not known exactly: a thousandth of itself at least.
constexpr double kLeastSpread = 1e-3;
constexpr double kLeastKnotSpread_psi = 0.02;
// Errors are known to a factor of two at best: they never explain all of what is seen.
constexpr double kLeastOfVariance = 0.25;

/// Standard deviations of a map's ways to differ, and over which input its local shifts are alike.
enum Part { kShift, kLocal, kGain, kOffset, kOwn, kLength, kParts };
using Sizes = std::array<double, kParts>;

/// A map's mean with its slopes.
struct MeanMap {
  VectorXd input, output, slope;
};

MatrixXd map_covariance(const MeanMap& map, const Sizes& size) {
  const Index n = map.output.size();
  MatrixXd c(n, n);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) {
      const double apart = (map.input(i) - map.input(j)) / size[kLength];
      const double along = size[kShift] * size[kShift] + size[kLocal] * size[kLocal] * std::exp(-0.5 * apart * apart);
      c(i, j) = map.slope(i) * map.slope(j) * along + size[kGain] * size[kGain] * map.output(i) * map.output(j) +
                size[kOffset] * size[kOffset];
    }
    c(i, i) += size[kOwn] * size[kOwn];
  }
  return c;
}

double log_likelihood(const MatrixXd& covariance, const MatrixXd& deviations) {
  const Eigen::LLT<MatrixXd> factor(covariance);
  if (factor.info() != Eigen::Success) return -std::numeric_limits<double>::infinity();
  const MatrixXd whitened = factor.matrixL().solve(deviations);
  const double half_log_determinant = factor.matrixLLT().diagonal().array().log().sum();
  return -0.5 * whitened.squaredNorm() - static_cast<double>(deviations.cols()) * half_log_determinant;
}

/// Sizes by maximum likelihood, a coordinate at a time on a finer and finer logarithmic grid.
Sizes fit_sizes(const MeanMap& map, const MatrixXd& errors, const MatrixXd& deviations, double scale) {
  const double typical = std::sqrt(deviations.squaredNorm() / static_cast<double>(deviations.size()));
  const double steep = std::max(map.slope.cwiseAbs().maxCoeff(), 1e-9);
  const double high = std::max(map.output.cwiseAbs().maxCoeff(), 1e-9);
  Sizes size{typical / steep, typical / steep, typical / high, 0.3 * typical, 0.3 * typical, kTypical_a * scale};
  size[kOwn] = std::max(size[kOwn], kLeastKnotSpread_psi);
  double best = log_likelihood(map_covariance(map, size) + errors, deviations);
  for (const double factor : {3.0, 3.0, 1.7, 1.7, 1.3, 1.3, 1.1}) {
    for (int part = 0; part < kParts; ++part) {
      for (const double by : {factor, 1 / factor}) {
        for (int times = 0; times < 6; ++times) {
          Sizes tried = size;
          tried[static_cast<std::size_t>(part)] *= by;
          tried[kOwn] = std::max(tried[kOwn], kLeastKnotSpread_psi);
          tried[kLength] = std::clamp(tried[kLength], kShortest_a * scale, kLongest_a * scale);
          const double likelihood = log_likelihood(map_covariance(map, tried) + errors, deviations);
          if (!(likelihood > best + 1e-9)) break;
          best = likelihood;
          size = tried;
        }
      }
    }
  }
  return size;
}

struct Sample {
  VectorXd mean;
  MatrixXd deviations;  ///< one column per valve

  MatrixXd covariance() const {
    return deviations * deviations.transpose() / static_cast<double>(deviations.cols() - 1);
  }
};

Sample sample_of(const MatrixXd& vectors) {
  Sample sample{.mean = vectors.rowwise().mean()};
  sample.deviations = vectors.colwise() - sample.mean;
  return sample;
}

MatrixXd target_covariance(const Sample& sample, const MatrixXd& errors, Index parameters,
                           const std::vector<double>& knots, double scale) {
  const Index p = sample.mean.size(), count = p - parameters;
  MatrixXd target = MatrixXd::Zero(p, p);
  const double n = static_cast<double>(sample.deviations.cols());
  for (Index j = 0; j < parameters; ++j) {
    const double least = kLeastSpread * std::max(std::abs(sample.mean(j)), 1e-6);
    const double variance = sample.deviations.row(j).squaredNorm() / (n - 1);
    target(j, j) = std::max({variance - errors(j, j), kLeastOfVariance * variance, least * least});
  }
  MeanMap map{.input = Eigen::Map<const VectorXd>(knots.data(), count),
              .output = sample.mean.tail(count),
              .slope = VectorXd(count)};
  for (Index k = 0; k < count; ++k) {
    const Index left = std::max<Index>(0, k - 1), right = std::min(count - 1, k + 1);
    map.slope(k) = (map.output(right) - map.output(left)) / (map.input(right) - map.input(left));
  }
  const MatrixXd deviations = sample.deviations.bottomRows(count) * std::sqrt(n / (n - 1));
  target.bottomRightCorner(count, count) =
      map_covariance(map, fit_sizes(map, errors.bottomRightCorner(count, count), deviations, scale));
  return target;
}

struct LeaveOneOut {
  double log_likelihood = 0, scale = 1;
};

/// How well each valve is predicted from the others, the scale of the prediction fitted to it.
LeaveOneOut leave_one_out(const MatrixXd& vectors, const MatrixXd& target, const MatrixXd& errors, double shrinkage) {
  const Index n = vectors.cols(), p = vectors.rows();
  double squares = 0, half_log_determinants = 0;
  for (Index i = 0; i < n; ++i) {
    MatrixXd others(p, n - 1);
    others << vectors.leftCols(i), vectors.rightCols(n - 1 - i);
    const Sample sample = sample_of(others);
    MatrixXd c = shrinkage * (target + errors);
    if (n > 2 && shrinkage < 1) c += (1 - shrinkage) * sample.covariance();
    c *= 1 + 1.0 / static_cast<double>(n - 1);
    const Eigen::LLT<MatrixXd> factor(c);
    squares += factor.matrixL().solve(vectors.col(i) - sample.mean).squaredNorm();
    half_log_determinants += factor.matrixLLT().diagonal().array().log().sum();
  }
  const double size = static_cast<double>(n * p);
  const double scale = std::max(1.0, squares / size);
  return {-0.5 * squares / scale - half_log_determinants - 0.5 * size * std::log(scale), scale};
}

}  // namespace

PopulationCovariance population_covariance(const MatrixXd& vectors, const MatrixXd& errors, Index parameters,
                                           const std::vector<double>& knots, double scale) {
  const Sample sample = sample_of(vectors);
  const MatrixXd target = target_covariance(sample, errors, parameters, knots, scale);
  double best_shrinkage = 1;
  LeaveOneOut best = leave_one_out(vectors, target, errors, 1);
  for (const double shrinkage : {0.9, 0.7, 0.5, 0.3, 0.15}) {
    const LeaveOneOut tried = leave_one_out(vectors, target, errors, shrinkage);
    if (!(tried.log_likelihood > best.log_likelihood)) continue;
    best = tried;
    best_shrinkage = shrinkage;
  }
  return {best.scale * ((1 - best_shrinkage) * sample.covariance() + best_shrinkage * target), best.log_likelihood};
}

}  // namespace valvetriage
