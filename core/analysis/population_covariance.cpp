#include "core/analysis/population_covariance.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

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
// Where all have none: of a loop of a milliampere, of a delay of a millisecond.
constexpr double kLeastParameter = 1e-3;
constexpr double kLeastKnotSpread = 1e-4;  // of the highest output
// Trimmed at a point, valves show nothing of how far a shift or a gain would take them without: it grows without end,
// until the small difference that is left of it is rounding.
constexpr double kMostOverTypical = 100;
// Errors are known to a factor of two at best: they never explain all of what is seen.
constexpr double kLeastOfVariance = 0.25;

/// Standard deviations of a map's ways to differ, over which input its local shifts are alike, and what is left of all
/// of them where valves are trimmed.
enum Part { kShift, kLocal, kGain, kOffset, kOwn, kLength, kTrimmed, kParts };
using Sizes = std::array<double, kParts>;

/// A map's mean with its slopes.
struct MeanMap {
  VectorXd input, output, slope;
};

/// How maps differ.
///
/// trim  the knot at which valves are set alike, none where there is no such
struct MapSpread {
  Sizes size{};
  std::optional<Index> trim{};
  double log_likelihood = -std::numeric_limits<double>::infinity();
};

MatrixXd map_covariance(const MeanMap& map, const MapSpread& spread) {
  const Index n = map.output.size();
  const Sizes& size = spread.size;
  MatrixXd c(n, n);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) {
      const double apart = (map.input(i) - map.input(j)) / size[kLength];
      const double along = size[kShift] * size[kShift] + size[kLocal] * size[kLocal] * std::exp(-0.5 * apart * apart);
      c(i, j) = map.slope(i) * map.slope(j) * along + size[kGain] * size[kGain] * map.output(i) * map.output(j) +
                size[kOffset] * size[kOffset];
    }
  }
  if (spread.trim) {
    // Whatever differs, a screw has brought this point together: the process given that it is there.
    const VectorXd with_trim = c.col(*spread.trim);
    c -= with_trim * with_trim.transpose() / (with_trim(*spread.trim) + size[kTrimmed] * size[kTrimmed]);
  }
  c.diagonal().array() += size[kOwn] * size[kOwn];
  return c;
}

double log_likelihood(const MatrixXd& covariance, const MatrixXd& deviations) {
  const Eigen::LLT<MatrixXd> factor(covariance);
  if (factor.info() != Eigen::Success) return -std::numeric_limits<double>::infinity();
  const MatrixXd whitened = factor.matrixL().solve(deviations);
  const double half_log_determinant = factor.matrixLLT().diagonal().array().log().sum();
  return -0.5 * whitened.squaredNorm() - static_cast<double>(deviations.cols()) * half_log_determinant;
}

/// Finds how maps differ by maximum likelihood, a coordinate at a time on a finer and finer logarithmic grid.
class SpreadSearch {
 public:
  SpreadSearch(const MeanMap& map, const MatrixXd& errors, const MatrixXd& deviations, double scale)
      : map_(map), errors_(errors), deviations_(deviations), scale_(scale), start_(start()) {}

  MapSpread run() const {
    MapSpread best = refined(start_, kFactors);
    MapSpread trimmed;
    for (Index knot = 0; knot < map_.output.size(); knot += kKnotsBetweenTrims) {
      MapSpread tried = best;
      tried.trim = knot;
      tried = refined(std::move(tried), kCoarseFactors);
      if (tried.log_likelihood > trimmed.log_likelihood) trimmed = std::move(tried);
    }
    if (trimmed.trim) trimmed = refined(std::move(trimmed), kFactors);
    return trimmed.log_likelihood > best.log_likelihood + kPriceOfATrim ? trimmed : best;
  }

 private:
  static constexpr std::array kFactors{3.0, 3.0, 1.7, 1.7, 1.3, 1.3, 1.1};
  static constexpr std::array kCoarseFactors{3.0, 1.7};
  static constexpr Index kKnotsBetweenTrims = 5;
  static constexpr double kPriceOfATrim = 2;  // where it is and how well it is set: Akaike

  MapSpread start() const {
    const double typical = std::sqrt(deviations_.squaredNorm() / static_cast<double>(deviations_.size()));
    const double steep = std::max(map_.slope.cwiseAbs().maxCoeff(), 1e-9);
    MapSpread spread;
    spread.size = {typical / steep, typical / steep,     typical / highest(), 0.3 * typical,
                   0.3 * typical,   kTypical_a * scale_, 0.3 * typical};
    return spread;
  }

  double highest() const { return std::max(map_.output.cwiseAbs().maxCoeff(), 1e-9); }

  template <std::size_t n>
  MapSpread refined(MapSpread spread, const std::array<double, n>& factors) const {
    weigh(spread);
    for (const double factor : factors) {
      for (int part = 0; part < (spread.trim ? kParts : kTrimmed); ++part) {
        for (const double by : {factor, 1 / factor}) {
          for (int times = 0; times < 6; ++times) {
            MapSpread tried = spread;
            tried.size[static_cast<std::size_t>(part)] *= by;
            weigh(tried);
            if (!(tried.log_likelihood > spread.log_likelihood + 1e-9)) break;
            spread = tried;
          }
        }
      }
    }
    return spread;
  }

  void weigh(MapSpread& spread) const {
    for (std::size_t part = 0; part < kLength; ++part) {
      spread.size[part] = std::min(spread.size[part], kMostOverTypical * start_.size[part]);
    }
    spread.size[kOwn] = std::max(spread.size[kOwn], kLeastKnotSpread * highest());
    spread.size[kTrimmed] = std::max(spread.size[kTrimmed], kLeastKnotSpread * highest());
    spread.size[kLength] = std::clamp(spread.size[kLength], kShortest_a * scale_, kLongest_a * scale_);
    spread.log_likelihood = log_likelihood(map_covariance(map_, spread) + errors_, deviations_);
  }

  const MeanMap& map_;
  const MatrixXd& errors_;
  const MatrixXd& deviations_;
  double scale_;
  MapSpread start_;
};

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
    const double least = kLeastSpread * std::max(std::abs(sample.mean(j)), kLeastParameter);
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
  const MatrixXd map_errors = errors.bottomRightCorner(count, count);
  target.bottomRightCorner(count, count) = map_covariance(map, SpreadSearch(map, map_errors, deviations, scale).run());
  return target;
}

struct LeaveOneOut {
  double log_likelihood = 0;
  double map_scale = 1;  ///< of standard deviations
};

/// How well each valve is predicted from the others. The scale of the map's prediction is fitted to that: its few sizes
/// hang on all of its knots. Of the parameters it would tell nothing, for each variance is that of these very valves.
LeaveOneOut leave_one_out(const MatrixXd& vectors, const MatrixXd& target, const MatrixXd& errors, Index parameters,
                          double shrinkage) {
  const Index n = vectors.cols(), p = vectors.rows(), knots = p - parameters;
  std::vector<MatrixXd> predicted;
  std::vector<VectorXd> deviations;
  double map_squares = 0;
  for (Index i = 0; i < n; ++i) {
    MatrixXd others(p, n - 1);
    others << vectors.leftCols(i), vectors.rightCols(n - 1 - i);
    const Sample sample = sample_of(others);
    MatrixXd c = shrinkage * (target + errors);
    if (n > 2 && shrinkage < 1) c += (1 - shrinkage) * sample.covariance();
    c *= 1 + 1.0 / static_cast<double>(n - 1);
    deviations.push_back(vectors.col(i) - sample.mean);
    const Eigen::LLT<MatrixXd> of_map(c.bottomRightCorner(knots, knots));
    map_squares += of_map.matrixL().solve(deviations.back().tail(knots)).squaredNorm();
    predicted.push_back(std::move(c));
  }
  LeaveOneOut result;
  result.map_scale = std::sqrt(std::max(1.0, map_squares / static_cast<double>(n * knots)));
  for (Index i = 0; i < n; ++i) {
    VectorXd unscaled = deviations[static_cast<std::size_t>(i)];
    unscaled.tail(knots) /= result.map_scale;
    const Eigen::LLT<MatrixXd> factor(predicted[static_cast<std::size_t>(i)]);
    result.log_likelihood -= 0.5 * factor.matrixL().solve(unscaled).squaredNorm() +
                             factor.matrixLLT().diagonal().array().log().sum() +
                             static_cast<double>(knots) * std::log(result.map_scale);
  }
  return result;
}

}  // namespace

PopulationCovariance population_covariance(const MatrixXd& vectors, const MatrixXd& errors, Index parameters,
                                           const std::vector<double>& knots, double scale) {
  const Sample sample = sample_of(vectors);
  const MatrixXd target = target_covariance(sample, errors, parameters, knots, scale);
  double best_shrinkage = 1;
  LeaveOneOut best = leave_one_out(vectors, target, errors, parameters, 1);
  for (const double shrinkage : {0.9, 0.7, 0.5, 0.3, 0.15}) {
    const LeaveOneOut tried = leave_one_out(vectors, target, errors, parameters, shrinkage);
    if (!(tried.log_likelihood > best.log_likelihood)) continue;
    best = tried;
    best_shrinkage = shrinkage;
  }
  MatrixXd covariance = (1 - best_shrinkage) * sample.covariance() + best_shrinkage * target;
  covariance.bottomRows(vectors.rows() - parameters) *= best.map_scale;
  covariance.rightCols(vectors.rows() - parameters) *= best.map_scale;
  return {std::move(covariance), best.log_likelihood};
}

}  // namespace valvetriage
