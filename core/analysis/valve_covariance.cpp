#include "core/analysis/valve_covariance.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "core/analysis/population_covariance.h"
#include "core/identify/valve_fit.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr Index kParameters = static_cast<Index>(kValveParameters.size());
enum Parameter : Index { kFrequency, kDamping, kDelay };
// A slope is drawn towards none as if so many valves more had shown none: eight valves that happen to agree in one are
// believed by half.
constexpr double kValvesWithout = 8;
// Frequencies or dampings that agree to a thousandth are held by a bound, and a slope would hang on the one that is
// not.
constexpr double kLeastSpread = 1e-3;

/// The parameters of all valves in coordinates in which they may vary independently, and the way there. The changes are
/// triangular, so volumes are kept and likelihoods compare.
struct Coordinates {
  MatrixXd vectors;        ///< one valve a column
  MatrixXd from_parts;     ///< of small differences
  double slopes = 0;       ///< that were fitted to these valves, in degrees of freedom: tr H of the ridge regression
  double of_residual = 0;  ///< what they take of the residual's: tr (2 H − H²)
};

Coordinates in_parts(const MatrixXd& parts) {
  return {parts, MatrixXd::Identity(parts.rows(), parts.rows())};
}

/// What a spool and its delay have in common at low frequencies, delay + 2 ζ / ωn, in the place of the delay:
/// recordings may tell the whole delay of a valve far better than how it is shared between its parts.
Coordinates in_whole_delay(const MatrixXd& parts) {
  Coordinates whole = in_parts(parts);
  double of_spool_s = 0;
  for (Index i = 0; i < parts.cols(); ++i) {
    const double own_s = 2 * std::exp(parts(kDamping, i) - parts(kFrequency, i));
    whole.vectors(kDelay, i) += own_s;
    of_spool_s += own_s / static_cast<double>(parts.cols());
  }
  whole.from_parts(kDelay, kDamping) = of_spool_s;
  whole.from_parts(kDelay, kFrequency) = -of_spool_s;
  return whole;
}

/// The delay less what goes with frequency and damping of the spool. None where these hardly differ.
std::optional<Coordinates> in_delay_beside_spool(const MatrixXd& parts) {
  const MatrixXd deviations = parts.colwise() - parts.rowwise().mean();
  MatrixXd spool(parts.cols(), 2);
  spool << deviations.row(kFrequency).transpose(), deviations.row(kDamping).transpose();
  const MatrixXd as_they_are = spool;
  const Eigen::RowVector2d sd = (spool.colwise().squaredNorm() / static_cast<double>(parts.cols() - 1)).cwiseSqrt();
  if (!(sd.minCoeff() > kLeastSpread)) return std::nullopt;
  spool.array().rowwise() /= sd.array();
  const Eigen::Matrix2d told = spool.transpose() * spool;
  const Eigen::Matrix2d weights = (told + kValvesWithout * Eigen::Matrix2d::Identity()).inverse();
  const Eigen::Vector2d slope =
      (weights * spool.transpose() * deviations.row(kDelay).transpose()).cwiseQuotient(sd.transpose());
  Coordinates beside = in_parts(parts);
  const Eigen::Matrix2d hat = weights * told;
  beside.slopes = hat.trace();
  beside.of_residual = 2 * hat.trace() - (hat * hat).trace();
  beside.from_parts(kDelay, kFrequency) = -slope(0);
  beside.from_parts(kDelay, kDamping) = -slope(1);
  beside.vectors.row(kDelay) -= (as_they_are * slope).transpose();
  return beside;
}

}  // namespace

MatrixXd valve_covariance(const MatrixXd& vectors, const MatrixXd& errors, const std::vector<double>& knots,
                          double scale, Index left_out) {
  std::vector<Coordinates> ways{in_parts(vectors), in_whole_delay(vectors)};
  if (vectors.cols() + left_out >= kFewestWithSlopes) {
    if (auto beside = in_delay_beside_spool(vectors)) ways.push_back(std::move(*beside));
  }
  const double valves = static_cast<double>(vectors.cols());
  MatrixXd best;
  double best_likelihood = -std::numeric_limits<double>::infinity();
  for (const Coordinates& way : ways) {
    const MatrixXd there = way.from_parts * errors * way.from_parts.transpose();
    PopulationCovariance found = population_covariance(way.vectors, there, kParameters, knots, scale);
    const double likelihood = found.log_likelihood - way.slopes;
    if (best.size() > 0 && !(likelihood > best_likelihood)) continue;
    // What the slopes have fitted away of the residual, and what they err by in the next valve.
    const double wider = std::sqrt((valves - 1) / (valves - 1 - way.of_residual) * (1 + way.slopes / valves));
    found.covariance.row(kDelay) *= wider;
    found.covariance.col(kDelay) *= wider;
    const MatrixXd to_parts = way.from_parts.inverse();
    best = to_parts * found.covariance * to_parts.transpose();
    best_likelihood = likelihood;
  }
  return best;
}

}  // namespace valvetriage
