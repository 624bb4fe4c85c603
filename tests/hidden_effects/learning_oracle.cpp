#include "tests/hidden_effects/learning_oracle.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "tests/hidden_effects/absorption.h"
#include "tests/hidden_effects/oracle.h"
#include "tests/hidden_effects/signatures.h"
#include "tests/stand/random.h"

namespace valvetriage::hidden_effects {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using stand::Random;

constexpr Index kGoodDrawn = 50'000;   // good valves, each with a reference of its own
constexpr Index kSpoiledDrawn = 6000;  // valves at a distance, over its signatures
constexpr Index kFewestDrawn = 200;    // of each signature
constexpr double kNear = 1.5;          // times as far at most: faults that are as large
constexpr int kToneFrequencies = 24;   // of a range
constexpr double kAlike = 0.995;       // cosine of signatures of which one is enough
constexpr double kLeastShown = 0.5;    // distance of a fault that has a direction of its own
constexpr double kHardlyKnown = 1e-6;  // precision of a quantity of which nothing is known, population's own at 1
constexpr double kSettled = 0.01;      // of −2 ln likelihood

/// Rows in which the noise is white and histories and first holds are known as far as they are.
class Whitened {
 public:
  explicit Whitened(const Absorption& baseline) {
    const MatrixXd own = baseline.columns.rightCols(baseline.columns.cols() - baseline.parameters()) / kNoisePsi;
    MatrixXd stack(own.rows() + own.cols(), own.cols());
    stack << own, MatrixXd::Identity(own.cols(), own.cols());
    basis_ = Eigen::HouseholderQR<MatrixXd>(stack).householderQ() * MatrixXd::Identity(stack.rows(), stack.cols());
  }
  Index rows() const { return basis_.rows(); }
  VectorXd operator()(const VectorXd& column_psi) const {
    VectorXd rows = VectorXd::Zero(basis_.rows());
    rows.head(column_psi.size()) = column_psi / kNoisePsi;
    return rows - basis_ * (basis_.transpose() * rows);
  }

 private:
  MatrixXd basis_;
};

/// One choice of a law's numbers: the signature that stands for it, and how far off it is by its own size.
struct Fault {
  Index signature = 0;
  double d = 0;
};

/// Signatures beside the quantities of a unit: all that a likelihood asks for are their products.
struct Products {
  MatrixXd quantities;  ///< CᵀC, noise variances per squared population standard deviations
  MatrixXd beside;      ///< Cᵀu, one column per signature, each of distance 1 to the whole population
  MatrixXd signatures;  ///< uᵀu
  std::vector<Fault> faults;
  bool has_any_size = false;  ///< its shape does not hang on its size

  /// The share of each signature in the faults that are d off: those of about that size, or else the nearest. A small
  /// fault and a large one of a law look otherwise, and the small one may look like a good valve.
  VectorXd weights_at(double d) const {
    const auto apart = [&](const Fault& fault) { return has_any_size ? 0 : std::abs(std::log(fault.d / d)); };
    double nearest = std::numeric_limits<double>::infinity();
    for (const Fault& fault : faults) nearest = std::min(nearest, apart(fault));
    VectorXd weights = VectorXd::Zero(signatures.rows());
    for (const Fault& fault : faults)
      if (apart(fault) <= std::max(nearest, std::log(kNear))) weights[fault.signature] += 1;
    return weights / weights.sum();
  }
};

/// Squared length off the quantities, where a new valve's are known with `precision`.
VectorXd off_quantities(const MatrixXd& quantities, const MatrixXd& beside, const VectorXd& energy, double precision) {
  const MatrixXd a = quantities + precision * MatrixXd::Identity(quantities.rows(), quantities.cols());
  const MatrixXd solved = a.llt().solve(beside);
  return energy - beside.cwiseProduct(solved).colwise().sum().transpose();
}

/// Those that are not alike, by the whole population; each stands for the ones that are like it.
Products products(const MatrixXd& quantities_of, const MatrixXd& columns, bool has_any_size) {
  const MatrixXd quantities = quantities_of.transpose() * quantities_of;
  const MatrixXd beside = quantities_of.transpose() * columns;
  const VectorXd length =
      off_quantities(quantities, beside, columns.colwise().squaredNorm(), 1).cwiseMax(0.0).cwiseSqrt();
  const MatrixXd known = quantities + MatrixXd::Identity(quantities.rows(), quantities.cols());
  const MatrixXd solved = known.llt().solve(beside);
  std::vector<Index> kept;
  std::vector<Fault> faults;
  for (Index i = 0; i < columns.cols(); ++i) {
    if (!(length[i] > (has_any_size ? 0 : kLeastShown))) continue;
    const auto is_like = [&](Index k) {
      const double along = columns.col(i).dot(columns.col(k)) - beside.col(k).dot(solved.col(i));
      return along > kAlike * length[i] * length[k];
    };
    const auto found = std::find_if(kept.begin(), kept.end(), is_like);
    faults.push_back({found - kept.begin(), length[i]});
    if (found == kept.end()) kept.push_back(i);
  }
  MatrixXd unit(columns.rows(), static_cast<Index>(kept.size()));
  for (std::size_t k = 0; k < kept.size(); ++k)
    unit.col(static_cast<Index>(k)) = columns.col(kept[k]) / length[kept[k]];
  return {quantities, quantities_of.transpose() * unit, unit.transpose() * unit, std::move(faults), has_any_size};
}

/// What a reference tells of the quantities of a new valve: Student's distribution of each.
class Learned {
 public:
  Learned(Index quantities, int good_valves, Random& random)
      : freedom_(good_valves - 1), middle_(quantities), square_(quantities) {
    const double n = good_valves;
    VectorXd of_valve(good_valves);
    for (Index j = 0; j < quantities; ++j) {
      for (double& one : of_valve) one = random.tolerance();
      middle_[j] = of_valve.mean();
      square_[j] = (of_valve.array() - middle_[j]).square().sum() / (n - 1) * (1 + 1 / n);
    }
  }
  const VectorXd& middle() const { return middle_; }
  double minus_twice_log(const VectorXd& theta) const {
    return (freedom_ + 1) * ((theta - middle_).array().square() / (freedom_ * square_.array())).log1p().sum();
  }
  /// Of the normal distributions that lie above it and touch it at θ.
  VectorXd precision(const VectorXd& theta) const {
    return (freedom_ + 1) / (freedom_ * square_.array() + (theta - middle_).array().square());
  }

 private:
  double freedom_;
  VectorXd middle_, square_;
};

struct Lowest {
  double value = std::numeric_limits<double>::infinity();
  VectorXd theta;
};

/// min over θ of θᵀAθ − 2bᵀθ − 2 ln p(θ), by normal distributions that touch p (majorisation) from two starts: a valve
/// of the middle, and one of which nothing is known.
Lowest lowest_of(const MatrixXd& a, const VectorXd& b, const Learned& learned) {
  constexpr int kMostSteps = 60;
  Lowest lowest;
  for (const bool is_known : {true, false}) {
    VectorXd precision = is_known ? learned.precision(learned.middle()) : VectorXd::Constant(b.size(), kHardlyKnown);
    double before = std::numeric_limits<double>::infinity();
    for (int step = 0; step < kMostSteps; ++step) {
      MatrixXd system = a;
      system.diagonal() += precision;
      VectorXd theta = system.llt().solve(b + precision.cwiseProduct(learned.middle()));
      const double value = theta.dot(a * theta) - 2 * b.dot(theta) + learned.minus_twice_log(theta);
      precision = learned.precision(theta);
      if (value < lowest.value) lowest = {value, std::move(theta)};
      if (before - value < kSettled) break;
      before = value;
    }
  }
  return lowest;
}

/// The search for one cause in drawn valves.
class Search {
 public:
  Search(Products products, int good_valves, bool either_sign)
      : products_(std::move(products)), good_valves_(good_valves), either_sign_(either_sign) {
    const Index p = products_.quantities.rows(), k = products_.signatures.rows();
    MatrixXd gram(p + k, p + k);
    gram << products_.quantities, products_.beside, products_.beside.transpose(), products_.signatures;
    const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(gram);
    noise_ = eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal();
    for (Index i = 0; i < k; ++i) {
      const VectorXd along = products_.beside.col(i);
      off_signature_.push_back(products_.quantities - along * along.transpose() / products_.signatures(i, i));
    }
  }

  Index signatures() const { return products_.signatures.rows(); }
  VectorXd weights_at(double d) const { return products_.weights_at(d); }

  /// z of a valve that has `signature` at distance d, beside a reference.
  double z_of_drawn(Index signature, double d, Random& random) const {
    const Index p = products_.quantities.rows();
    const Learned learned(p, good_valves_, random);
    VectorXd theta(p), normal(noise_.cols());
    for (double& one : theta) one = random.tolerance();
    for (double& one : normal) one = random.normal();
    const VectorXd noise = noise_ * normal;
    const VectorXd along_quantities =
        products_.quantities * theta + d * products_.beside.col(signature) + noise.head(p);
    const VectorXd along_signatures =
        products_.beside.transpose() * theta + d * products_.signatures.col(signature) + noise.tail(signatures());
    const double without = lowest_of(products_.quantities, along_quantities, learned).value;
    double best = 0;
    for (Index i = 0; i < signatures(); ++i) {
      // The size that is best beside θ is taken out: what is left is a search for θ alone.
      const double energy = products_.signatures(i, i), share = along_signatures[i] / energy;
      const VectorXd beside = products_.beside.col(i);
      const Lowest with =
          lowest_of(off_signature_[static_cast<std::size_t>(i)], along_quantities - share * beside, learned);
      const double size = share - beside.dot(with.theta) / energy;
      if (size >= 0 || either_sign_) best = std::max(best, without - with.value + energy * share * share);
    }
    return std::sqrt(best);
  }

 private:
  Products products_;
  int good_valves_;
  bool either_sign_;
  MatrixXd noise_;
  std::vector<MatrixXd> off_signature_;
};

/// The greatest z of drawn good valves, the largest first.
std::vector<double> greatest_in_good_valves(const Search& search) {
  Random random(20261129, "learning oracle");
  std::vector<double> found;
  for (Index draw = 0; draw < kGoodDrawn; ++draw) found.push_back(search.z_of_drawn(0, 0, random));
  std::sort(found.begin(), found.end(), std::greater<>());
  return found;
}

/// The share of spoiled valves at distance d whose z is above the threshold, over the numbers of a law.
double seen_at(const Search& search, double d, double threshold) {
  Random random(20261129, "what the learning oracle sees");
  const VectorXd weights = search.weights_at(d);
  const Index draws = std::max(kFewestDrawn, kSpoiledDrawn / (weights.array() > 0).count());
  double seen = 0;
  for (Index i = 0; i < search.signatures(); ++i) {
    if (weights[i] == 0) continue;
    Index above = 0;
    for (Index draw = 0; draw < draws; ++draw) above += search.z_of_drawn(i, d, random) > threshold ? 1 : 0;
    seen += weights[i] * static_cast<double>(above) / static_cast<double>(draws);
  }
  return seen;
}

SearchOf by_drawing(const std::string& cause, const Search& search) {
  constexpr double kFarthest = 400, kClose = 1.01;
  SearchOf found{cause, {}, {}};
  const std::vector<double> sorted = greatest_in_good_valves(search);
  for (std::size_t a = 0; a < kAlarms.size(); ++a) {
    found.threshold[a] = exceeded_at(sorted, share_of(kAlarms[a], searched_causes()));
    double low = found.threshold[a], high = kFarthest;
    while (high > kClose * low) {
      const double middle = std::sqrt(low * high);
      (seen_at(search, middle, found.threshold[a]) < 0.9 ? low : high) = middle;
    }
    found.d90[a] = std::sqrt(low * high);
  }
  return found;
}

/// Of an observer who knows nothing of the quantities of a unit: each signature is as much shorter to it.
SearchOf without_population(const SearchOf& known, const Products& products) {
  SearchOf found = known;
  const VectorXd shorter =
      off_quantities(products.quantities, products.beside, products.signatures.diagonal(), kHardlyKnown)
          .cwiseMax(0.0)
          .cwiseSqrt();
  for (std::size_t a = 0; a < kAlarms.size(); ++a) {
    // Of a tone, whose phase is searched, what is seen at d is not Φ(d − threshold): the excess is taken over.
    const double excess = known.d90[a] - kNineInTen;
    found.d90[a] = root_of_falling(
        [&](double d) {
          const VectorXd weights = products.weights_at(d);
          double missed = 0;
          for (Index i = 0; i < shorter.size(); ++i) missed += weights[i] * tail_of_normal(shorter[i] * d - excess);
          return missed - 0.1;
        },
        0, 1000);
  }
  return found;
}

/// A tone of the range's frequencies in all recordings, in two phases.
std::vector<VectorXd> columns_of(const Tones& tones, const TwinBench& bench) {
  std::vector<VectorXd> found;
  for (int i = 0; i < kToneFrequencies; ++i) {
    const double hertz = tones.low_hz + (tones.high_hz - tones.low_hz) * (i + 0.5) / kToneFrequencies;
    for (const double phase : {0.0, 0.5 * std::numbers::pi})
      found.push_back(bench.column_of([&](std::size_t recording, Index row) {
        return std::cos(2 * std::numbers::pi * hertz * bench.time_s(recording, row) + phase);
      }));
  }
  return found;
}

}  // namespace

std::vector<SearchOf> learning_oracle(const std::vector<std::string>& tests, int good_valves) {
  if (good_valves < 3) throw std::invalid_argument("a population is learned from three good valves at least");
  const TwinBench bench = nominal_bench(tests);
  const Absorption baseline(bench);
  const Whitened whitened(baseline);
  const auto whitened_all = [&](const auto& columns) {
    MatrixXd all(whitened.rows(), static_cast<Index>(columns.size()));
    for (Index i = 0; i < all.cols(); ++i) all.col(i) = whitened(columns[static_cast<std::size_t>(i)]);
    return all;
  };
  std::vector<VectorXd> quantities;
  for (Index j = 0; j < baseline.parameters(); ++j) quantities.push_back(baseline.columns.col(j));
  const MatrixXd quantities_of = whitened_all(quantities);
  const std::vector<SearchOf> known = oracle(tests);
  const auto known_of = [&](const std::string& cause) {
    return *std::find_if(known.begin(), known.end(), [&](const SearchOf& one) { return one.cause == cause; });
  };
  std::vector<SearchOf> found;
  for (const Signatures& one : signatures(bench)) {
    Products of_cause = products(quantities_of, whitened_all(one.columns), one.either_sign);
    found.push_back(one.cause == "intermittent"
                        ? without_population(known_of(one.cause), of_cause)
                        : by_drawing(one.cause, Search(std::move(of_cause), good_valves, one.either_sign)));
  }
  for (const Tones& tones : searched_tones(bench))
    found.push_back(without_population(known_of(tones.cause),
                                       products(quantities_of, whitened_all(columns_of(tones, bench)), true)));
  return found;
}

}  // namespace valvetriage::hidden_effects
