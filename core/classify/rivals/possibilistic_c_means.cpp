#include "core/classify/rivals/possibilistic_c_means.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace valvetriage {
namespace {

constexpr double kSettled = 1e-9;      // of a standard deviation
constexpr double kSamePlace = 0.25;    // of η: prototypes nearer than half the distance of typicality 1/2 are one
constexpr double kPulls = 0.25;        // typicality: thousands of rows that lie farther do not add up to a pull
constexpr Eigen::Index kSample = 512;  // rows that tell how dense the others lie

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

/// Rows with their lengths, so that distances to a place are one product.
struct Rows {
  explicit Rows(const Eigen::MatrixXd& of) : x(of), squared_norms(of.rowwise().squaredNorm()) {}

  Eigen::VectorXd squared_distances(const Eigen::RowVectorXd& place) const {
    return (squared_norms - 2 * (x * place.transpose())).array() + place.squaredNorm();
  }

  const Eigen::MatrixXd& x;
  Eigen::VectorXd squared_norms;
};

/// Pull of rows at these distances on a place: t^m, nothing below kPulls.
Eigen::ArrayXd pulls(const Eigen::ArrayXd& squared_distances, double eta, double fuzzifier) {
  const Eigen::ArrayXd t = (1 + (squared_distances.max(0) / eta).pow(1 / (fuzzifier - 1))).inverse();
  return (t < kPulls).select(0, t.pow(fuzzifier));
}

/// Rows in the order of the pull that they feel where they are, strongest first.
std::vector<Eigen::Index> densest_first(const Rows& rows, double eta, double fuzzifier) {
  const Eigen::Index n = rows.x.rows(), step = (n + kSample - 1) / kSample;
  Eigen::ArrayXd density = Eigen::ArrayXd::Zero(n);
  for (Eigen::Index j = 0; j < n; j += step) density += pulls(rows.squared_distances(rows.x.row(j)), eta, fuzzifier);
  std::vector<Eigen::Index> order(static_cast<std::size_t>(n));
  std::iota(order.begin(), order.end(), Eigen::Index{0});
  std::stable_sort(order.begin(), order.end(), [&](Eigen::Index a, Eigen::Index b) { return density(a) > density(b); });
  return order;
}

/// Where a prototype that starts at `place` settles.
Eigen::RowVectorXd settled(const Rows& rows, Eigen::RowVectorXd place, double eta,
                           const PossibilisticOptions& options) {
  for (int iteration = 0; iteration < options.most_iterations; ++iteration) {
    const Eigen::ArrayXd pull = pulls(rows.squared_distances(place), eta, options.fuzzifier);
    if (pull.sum() == 0) break;
    Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(place.size());
    for (Eigen::Index j = 0; j < pull.size(); ++j) {
      if (pull(j) > 0) sum += pull(j) * rows.x.row(j);
    }
    const Eigen::RowVectorXd moved = sum / pull.sum();
    const double change = (moved - place).cwiseAbs().maxCoeff();
    place = moved;
    if (change < kSettled) break;
  }
  return place;
}

/// The distinct places at which prototypes settle.
Eigen::MatrixXd dense_places(const Rows& rows, double eta, const PossibilisticOptions& options) {
  std::vector<Eigen::RowVectorXd> places;
  std::vector<bool> taken(static_cast<std::size_t>(rows.x.rows()));
  int starts = 0;
  for (const Eigen::Index row : densest_first(rows, eta, options.fuzzifier)) {
    if (taken[static_cast<std::size_t>(row)]) continue;
    if (starts++ == options.most_starts) break;
    const Eigen::RowVectorXd place = settled(rows, rows.x.row(row), eta, options);
    const bool known = std::any_of(places.begin(), places.end(), [&](const Eigen::RowVectorXd& other) {
      return (other - place).squaredNorm() < kSamePlace * eta;
    });
    if (known) continue;
    places.push_back(place);
    const Eigen::VectorXd distances = rows.squared_distances(place);
    for (Eigen::Index j = 0; j < distances.size(); ++j) {
      if (distances(j) <= eta) taken[static_cast<std::size_t>(j)] = true;
    }
  }
  Eigen::MatrixXd prototypes(Eigen::Index(places.size()), rows.x.cols());
  for (std::size_t k = 0; k < places.size(); ++k) prototypes.row(Eigen::Index(k)) = places[k];
  return prototypes;
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
  const Eigen::MatrixXd prototypes = dense_places(Rows{x}, eta, options);
  const Eigen::VectorXd etas = Eigen::VectorXd::Constant(prototypes.rows(), eta);
  const Eigen::MatrixXd t = typicalities(squared_distances(prototypes, x), etas, options.fuzzifier);
  std::vector<PatternGroup> groups(std::size_t(prototypes.rows()));
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
