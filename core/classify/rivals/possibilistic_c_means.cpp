#include "core/classify/rivals/possibilistic_c_means.h"

#include <algorithm>
#include <cmath>

namespace valvetriage {
namespace {

constexpr double kSettled = 1e-9;  // of a standard deviation

struct Clusters {
  std::vector<Verdict> verdicts;
  Eigen::MatrixXd prototypes;  ///< c × p
  Eigen::VectorXd eta;         ///< c, squared distance of typicality 1/2
};

Eigen::MatrixXd squared_distances(const Eigen::MatrixXd& prototypes, const Eigen::MatrixXd& x) {
  Eigen::MatrixXd distances(prototypes.rows(), x.rows());
  for (Eigen::Index i = 0; i < prototypes.rows(); ++i) {
    distances.row(i) = (x.rowwise() - prototypes.row(i)).rowwise().squaredNorm().transpose();
  }
  return distances.cwiseMax(1e-12);
}

/// Degrees of fuzzy c-means (Bezdek): each column adds up to 1.
Eigen::MatrixXd fuzzy_degrees(const Eigen::MatrixXd& distances, double fuzzifier) {
  Eigen::MatrixXd degrees = distances.array().pow(-1 / (fuzzifier - 1));
  degrees.array().rowwise() /= degrees.colwise().sum().array().eval();
  return degrees;
}

Eigen::MatrixXd typicalities(const Eigen::MatrixXd& distances, const Eigen::VectorXd& eta, double fuzzifier) {
  const Eigen::ArrayXXd ratio = distances.array().colwise() / eta.array();
  return (1 + ratio.pow(1 / (fuzzifier - 1))).inverse();
}

Eigen::MatrixXd weighted_means(const Eigen::MatrixXd& weights, const Eigen::MatrixXd& x) {
  Eigen::MatrixXd means = weights * x;
  means.array().colwise() /= weights.rowwise().sum().array();
  return means;
}

Clusters class_means(const Eigen::MatrixXd& x, const std::vector<Verdict>& verdicts) {
  Clusters clusters;
  for (const Verdict verdict : kVerdicts) {
    if (std::find(verdicts.begin(), verdicts.end(), verdict) != verdicts.end()) clusters.verdicts.push_back(verdict);
  }
  Eigen::MatrixXd member(Eigen::Index(clusters.verdicts.size()), x.rows());
  for (Eigen::Index i = 0; i < member.rows(); ++i) {
    for (Eigen::Index j = 0; j < x.rows(); ++j)
      member(i, j) = verdicts[std::size_t(j)] == clusters.verdicts[std::size_t(i)];
  }
  clusters.prototypes = weighted_means(member, x);
  return clusters;
}

/// Repeats prototypes -> degrees -> prototypes until they settle.
template <typename Degrees>
void refine(Clusters& clusters, const Eigen::MatrixXd& x, const PossibilisticOptions& options, Degrees degrees_of) {
  for (int iteration = 0; iteration < options.most_iterations; ++iteration) {
    const Eigen::MatrixXd degrees = degrees_of(squared_distances(clusters.prototypes, x));
    const Eigen::MatrixXd moved = weighted_means(degrees.array().pow(options.fuzzifier), x);
    const double change = (moved - clusters.prototypes).cwiseAbs().maxCoeff();
    clusters.prototypes = moved;
    if (change < kSettled) return;
  }
}

}  // namespace

RivalClassifier train_possibilistic_c_means(const TrainingSet& training, const PossibilisticOptions& options) {
  const Standardiser standardise(training.features);
  const Eigen::MatrixXd x = standardise.all(training.features);
  Clusters clusters = class_means(x, training.verdicts);
  refine(clusters, x, options, [&](const Eigen::MatrixXd& d) { return fuzzy_degrees(d, options.fuzzifier); });

  const Eigen::MatrixXd distances = squared_distances(clusters.prototypes, x);
  const Eigen::MatrixXd weights = fuzzy_degrees(distances, options.fuzzifier).array().pow(options.fuzzifier);
  clusters.eta = weights.cwiseProduct(distances).rowwise().sum().cwiseQuotient(weights.rowwise().sum());
  refine(clusters, x, options,
         [&](const Eigen::MatrixXd& d) { return typicalities(d, clusters.eta, options.fuzzifier); });

  return [=](const Eigen::VectorXd& features) {
    const Eigen::MatrixXd at = standardise(features).transpose();
    const Eigen::MatrixXd t = typicalities(squared_distances(clusters.prototypes, at), clusters.eta, options.fuzzifier);
    Memberships memberships{};
    for (std::size_t i = 0; i < clusters.verdicts.size(); ++i) {
      memberships[index_of(clusters.verdicts[i])] = t(Eigen::Index(i), 0);
    }
    return by_largest(memberships);
  };
}

}  // namespace valvetriage
