#include "core/classify/rivals/self_organising_map.h"

#include <Eigen/Core>
#include <cmath>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

constexpr double kLastRadius = 0.5;

/// Node positions on the square map, side² × 2.
Eigen::MatrixXd node_positions(int side) {
  Eigen::MatrixXd positions(side * side, 2);
  for (int i = 0; i < side * side; ++i) positions.row(i) << i / side, i % side;
  return positions;
}

/// Weights on the plane of the two leading components, two standard deviations to either side.
Eigen::MatrixXd plane_weights(const Eigen::MatrixXd& x, const Eigen::MatrixXd& positions, int side) {
  const RightSingular svd = right_singular(x);
  const double half = std::max(0.5, (side - 1) / 2.0);
  Eigen::MatrixXd weights = Eigen::MatrixXd::Zero(positions.rows(), x.cols());
  const Eigen::Index axes = std::min<Eigen::Index>(2, svd.values.size());
  for (Eigen::Index axis = 0; axis < axes; ++axis) {
    const double sd = svd.values(axis) / std::sqrt(double(x.rows()));
    const Eigen::VectorXd along = (positions.col(axis).array() - (side - 1) / 2.0) / half * 2 * sd;
    weights += along * svd.vectors.col(axis).transpose();
  }
  return weights;
}

Eigen::Index winner(const Eigen::MatrixXd& weights, const Eigen::RowVectorXd& x) {
  Eigen::Index nearest = 0;
  (weights.rowwise() - x).rowwise().squaredNorm().minCoeff(&nearest);
  return nearest;
}

/// h of every node to every sample's winner, nodes × n.
Eigen::MatrixXd neighbourhood(const Eigen::MatrixXd& weights, const Eigen::MatrixXd& positions,
                              const Eigen::MatrixXd& x, double radius) {
  Eigen::MatrixXd h(weights.rows(), x.rows());
  for (Eigen::Index j = 0; j < x.rows(); ++j) {
    const Eigen::RowVectorXd centre = positions.row(winner(weights, x.row(j)));
    h.col(j) = (-(positions.rowwise() - centre).rowwise().squaredNorm().array() / (2 * radius * radius)).exp();
  }
  return h;
}

}  // namespace

RivalClassifier train_self_organising_map(const TrainingSet& training, const SelfOrganisingMapOptions& options) {
  const Standardiser standardise(training.features);
  const Eigen::MatrixXd x = standardise.all(training.features);
  const Eigen::MatrixXd positions = node_positions(options.side);
  Eigen::MatrixXd weights = plane_weights(x, positions, options.side);
  const double first_radius = std::max(options.side / 2.0, kLastRadius);
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    const double progress = double(iteration) / std::max(1, options.iterations - 1);
    const double radius = first_radius * std::pow(kLastRadius / first_radius, progress);
    const Eigen::MatrixXd h = neighbourhood(weights, positions, x, radius);
    weights = h * x;
    weights.array().colwise() /= h.rowwise().sum().array();
  }
  Eigen::MatrixXd one_hot = Eigen::MatrixXd::Zero(x.rows(), kVerdictCount);
  for (Eigen::Index j = 0; j < x.rows(); ++j) one_hot(j, Eigen::Index(index_of(training.verdicts[std::size_t(j)]))) = 1;
  Eigen::MatrixXd shares = neighbourhood(weights, positions, x, kLastRadius) * one_hot;
  shares.array().colwise() /= shares.rowwise().sum().array().eval();

  return [=](const Eigen::VectorXd& features) {
    const Eigen::Index node = winner(weights, standardise(features).transpose());
    Memberships memberships{};
    for (std::size_t c = 0; c < kVerdictCount; ++c) memberships[c] = shares(node, Eigen::Index(c));
    return by_largest(memberships);
  };
}

}  // namespace valvetriage
