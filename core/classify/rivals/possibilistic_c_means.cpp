#include "core/classify/rivals/possibilistic_c_means.h"

#include <algorithm>
#include <cmath>

namespace valvetriage {
namespace {

constexpr double kSettled = 1e-9;    // of a standard deviation
constexpr double kSamePlace = 0.25;  // of η: prototypes nearer than half the distance of typicality 1/2 are one

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

std::vector<PatternGroup> possibilistic_groups(const Eigen::MatrixXd& x, double eta,
                                               const PossibilisticOptions& options) {
  if (x.rows() == 0) return {};
  Clusters clusters{.verdicts = {}, .prototypes = x, .eta = Eigen::VectorXd::Constant(x.rows(), eta)};
  refine(clusters, x, options,
         [&](const Eigen::MatrixXd& d) { return typicalities(d, clusters.eta, options.fuzzifier); });
  std::vector<Eigen::Index> distinct;
  for (Eigen::Index i = 0; i < clusters.prototypes.rows(); ++i) {
    const bool known = std::any_of(distinct.begin(), distinct.end(), [&](Eigen::Index k) {
      return (clusters.prototypes.row(k) - clusters.prototypes.row(i)).squaredNorm() < kSamePlace * eta;
    });
    if (!known) distinct.push_back(i);
  }
  const Eigen::MatrixXd prototypes = clusters.prototypes(distinct, Eigen::all);
  const Eigen::VectorXd etas = Eigen::VectorXd::Constant(prototypes.rows(), eta);
  const Eigen::MatrixXd t = typicalities(squared_distances(prototypes, x), etas, options.fuzzifier);
  std::vector<PatternGroup> groups(distinct.size());
  for (Eigen::Index j = 0; j < x.rows(); ++j) {
    Eigen::Index best = 0;
    if (t.col(j).maxCoeff(&best) >= 0.5) groups[std::size_t(best)].members.push_back(std::size_t(j));
  }
  for (std::size_t k = 0; k < groups.size(); ++k) {
    groups[k].prototype = prototypes.row(Eigen::Index(k));
    const auto of = [&](std::size_t member) { return t(Eigen::Index(k), Eigen::Index(member)); };
    std::stable_sort(groups[k].members.begin(), groups[k].members.end(),
                     [&](std::size_t a, std::size_t b) { return of(a) > of(b); });
    for (const std::size_t member : groups[k].members) groups[k].typicality.push_back(of(member));
  }
  std::erase_if(groups, [](const PatternGroup& group) { return group.members.size() < 2; });
  std::stable_sort(groups.begin(), groups.end(),
                   [](const PatternGroup& a, const PatternGroup& b) { return a.members.size() > b.members.size(); });
  return groups;
}

}  // namespace valvetriage
