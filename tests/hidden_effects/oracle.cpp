#include "tests/hidden_effects/oracle.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <string_view>
#include <utility>

#include "tests/hidden_effects/absorption.h"
#include "tests/hidden_effects/signatures.h"
#include "tests/stand/random.h"

namespace valvetriage::hidden_effects {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using stand::Random;

constexpr Index kBatch = 4096;      // good valves that are drawn at once
constexpr double kKept = 1e-6;      // of the largest eigenvalue
constexpr double kShortest = 1e-3;  // of the longest signature: what is shorter has no direction of its own

/// Signatures [psi], one per column, whitened and at unit length; those that hardly show are left out.
MatrixXd directions(const Absorption& baseline, const std::vector<VectorXd>& signatures) {
  MatrixXd all(baseline.basis.rows(), static_cast<Index>(signatures.size()));
  for (std::size_t i = 0; i < signatures.size(); ++i)
    all.col(static_cast<Index>(i)) = baseline.off_baseline(baseline.stacked(signatures[i]));
  const VectorXd length = all.colwise().norm();
  MatrixXd kept(all.rows(), all.cols());
  Index count = 0;
  for (Index i = 0; i < all.cols(); ++i)
    if (length[i] > kShortest * length.maxCoeff()) kept.col(count++) = all.col(i) / length[i];
  return kept.leftCols(count);
}

/// L with L·Lᵀ = UᵀU: L·g of a normal g has the correlations of Uᵀr.
MatrixXd factor_of(const MatrixXd& directions) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> gram(directions.transpose() * directions);
  const VectorXd& values = gram.eigenvalues();
  const Index kept = (values.array() > kKept * values.maxCoeff()).count();
  return gram.eigenvectors().rightCols(kept) * values.tail(kept).cwiseSqrt().asDiagonal();
}

/// The greatest correlation in each of `draws` good valves, the largest first.
std::vector<double> greatest(const MatrixXd& directions, Index draws, bool either_sign) {
  const MatrixXd factor = factor_of(directions);
  Random random(20261129, "oracle");
  std::vector<double> found;
  MatrixXd normal(factor.cols(), kBatch);
  while (static_cast<Index>(found.size()) < draws) {
    for (Index i = 0; i < normal.size(); ++i) normal.data()[i] = random.normal();
    MatrixXd z = factor * normal;
    if (either_sign) z = z.cwiseAbs();
    for (Index i = 0; i < z.cols(); ++i) found.push_back(z.col(i).maxCoeff());
  }
  std::sort(found.begin(), found.end(), std::greater<>());
  return found;
}

SearchOf by_drawing(const Signatures& signatures, const MatrixXd& directions, Index draws) {
  SearchOf found{signatures.cause, {}, {}};
  const std::vector<double> sorted = greatest(directions, draws, signatures.either_sign);
  for (std::size_t a = 0; a < kAlarms.size(); ++a) {
    found.threshold[a] = exceeded_at(sorted, share_of(kAlarms[a], searched_causes()));
    found.d90[a] = found.threshold[a] + kNineInTen;
  }
  return found;
}

/// One amplitude in all recordings and a phase of its own in each. With w_i the root of a recording's share of the
/// samples and ρ_i the moduli of its complex correlation, z = Σ w_i ρ_i.
class Tone {
 public:
  explicit Tone(const TwinBench& bench) : weight_(static_cast<Index>(bench.recordings())) {
    for (std::size_t i = 0; i < bench.recordings(); ++i)
      weight_[static_cast<Index>(i)] =
          std::sqrt(static_cast<double>(bench.size(i)) / static_cast<double>(bench.samples()));
  }

  /// Probability of z above `threshold` at one frequency of a good valve: drawn from recordings that hold a tone of
  /// that size, weighed by how much rarer it is without.
  double tail(double threshold) const {
    double sum = 0;
    for (const auto& [z, log_ratio] : drawn(threshold))
      if (z > threshold) sum += std::exp(log_ratio);
    return sum / kDraws;
  }

  /// The d of which z exceeds `threshold` nine times in ten.
  double seen_at(double threshold) const {
    return root_of_falling(
        [&](double d) {
          const auto held = drawn(d);
          const auto above =
              std::count_if(held.begin(), held.end(), [&](const auto& one) { return one.first > threshold; });
          return 0.9 - static_cast<double>(above) / kDraws;
        },
        0, 3 * threshold);
  }

 private:
  static constexpr int kDraws = 100'000;

  /// (z, log of the chance without a tone over that with one) of recordings with a tone of distance d.
  std::vector<std::pair<double, double>> drawn(double d) const {
    Random random(20261129, "oracle of tones");
    std::vector<std::pair<double, double>> found;
    for (int draw = 0; draw < kDraws; ++draw) {
      double z = 0, log_ratio = 0;
      for (const double weight : weight_) {
        const double modulus = std::hypot(d * weight + random.normal(), random.normal());
        z += weight * modulus;
        log_ratio += 0.5 * d * d * weight * weight - std::log(std::cyl_bessel_i(0.0, d * weight * modulus));
      }
      found.emplace_back(z, log_ratio);
    }
    return found;
  }

  VectorXd weight_;
};

SearchOf of_tone(const Tones& tones, const TwinBench& bench) {
  const Tone tone(bench);
  SearchOf found{tones.cause, {}, {}};
  for (std::size_t a = 0; a < kAlarms.size(); ++a) {
    found.threshold[a] = root_of_falling(
        [&](double z) { return tones.places * tone.tail(z) - share_of(kAlarms[a], searched_causes()); }, 1, 30);
    found.d90[a] = tone.seen_at(found.threshold[a]);
  }
  return found;
}

}  // namespace

std::vector<SearchOf> oracle(const std::vector<std::string>& tests) {
  constexpr Index kDraws = 1'000'000, kDrawsOfContacts = 200'000;
  const TwinBench bench = nominal_bench(tests);
  const Absorption baseline(bench);
  std::vector<SearchOf> found;
  for (const Signatures& one : signatures(bench)) {
    const Index draws = one.cause == "intermittent" ? kDrawsOfContacts : kDraws;
    found.push_back(by_drawing(one, directions(baseline, one.columns), draws));
  }
  for (const Tones& tones : searched_tones(bench)) found.push_back(of_tone(tones, bench));
  return found;
}

}  // namespace valvetriage::hidden_effects
