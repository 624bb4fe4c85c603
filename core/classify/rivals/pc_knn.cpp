#include "core/classify/rivals/pc_knn.h"

#include <Eigen/Core>
#include <algorithm>
#include <numeric>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

/// Directions (p × q) that carry the share of the variance.
Eigen::MatrixXd leading_components(const Eigen::MatrixXd& standardised, double share) {
  const RightSingular svd = right_singular(standardised);
  const Eigen::VectorXd variance = svd.values.cwiseAbs2();
  double carried = 0;
  Eigen::Index count = 0;
  while (count < variance.size() && carried < share * variance.sum()) carried += variance(count++);
  return svd.vectors.leftCols(std::max<Eigen::Index>(count, 1));
}

}  // namespace

RivalClassifier train_pc_knn(const TrainingSet& training, const PcKnnOptions& options) {
  const Standardiser standardise(training.features);
  const Eigen::MatrixXd standardised = standardise.all(training.features);
  const Eigen::MatrixXd components = leading_components(standardised, options.variance_share);
  const Eigen::MatrixXd scores = standardised * components;
  const auto k = std::min<std::size_t>(std::size_t(options.neighbours), training.verdicts.size());
  return [=, verdicts = training.verdicts](const Eigen::VectorXd& x) {
    const Eigen::RowVectorXd at = standardise(x).transpose() * components;
    const Eigen::VectorXd distance = (scores.rowwise() - at).rowwise().squaredNorm();
    std::vector<std::size_t> order(verdicts.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto nearer = [&](std::size_t a, std::size_t b) {
      return std::pair(distance(Eigen::Index(a)), a) < std::pair(distance(Eigen::Index(b)), b);
    };
    std::partial_sort(order.begin(), order.begin() + std::ptrdiff_t(k), order.end(), nearer);
    Memberships votes{};
    for (std::size_t i = 0; i < k; ++i) votes[index_of(verdicts[order[i]])] += 1.0 / double(k);
    return by_largest(votes);
  };
}

}  // namespace valvetriage
