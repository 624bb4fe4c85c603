#include "tests/hidden_effects/oracle.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <string_view>
#include <utility>

#include "tests/hidden_effects/absorption.h"
#include "tests/hidden_effects/output_rivals.h"
#include "tests/hidden_effects/rivals.h"
#include "tests/stand/random.h"

namespace valvetriage::hidden_effects {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using stand::Random;

constexpr double kNineInTen = 1.2815515655446004;
constexpr int kSizes = 24;
constexpr int kSeconds = 5;         // values of a second number
constexpr Index kInstants = 20;     // rows between the instants of a contact
constexpr Index kBatch = 4096;      // good valves that are drawn at once
constexpr double kKept = 1e-6;      // of the largest eigenvalue
constexpr double kShortest = 1e-3;  // of the longest signature: what is shorter has no direction of its own
constexpr std::size_t kOutputCauses = 6;

double tail_of_normal(double z) {
  return 0.5 * std::erfc(z / std::numbers::sqrt2);
}

/// The root of a falling function.
template <class Function>
double root_of_falling(Function value, double low, double high) {
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (value(middle) > 0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

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

/// The threshold that is exceeded at `rate`; below `fewest` drawn exceedances the tail is that of as many independent
/// signatures as make the last rate that was counted.
double exceeded_at(const std::vector<double>& sorted, double rate) {
  constexpr double kFewest = 40;
  const auto draws = static_cast<double>(sorted.size());
  if (rate * draws >= kFewest) return sorted[static_cast<std::size_t>(rate * draws)];
  const double counted = sorted[static_cast<std::size_t>(kFewest)];
  const double signatures = kFewest / draws / tail_of_normal(counted);
  return root_of_falling([&](double z) { return signatures * tail_of_normal(z) - rate; }, counted, 40);
}

SearchOf by_drawing(const std::string& cause, const MatrixXd& directions, double causes, Index draws,
                    bool either_sign) {
  SearchOf found{cause, {}, {}};
  const std::vector<double> sorted = greatest(directions, draws, either_sign);
  for (std::size_t a = 0; a < kAlarms.size(); ++a) {
    found.threshold[a] = exceeded_at(sorted, kAlarms[a] / causes);
    found.d90[a] = found.threshold[a] + kNineInTen;
  }
  return found;
}

std::vector<double> grid_of(const Axis& axis, double low, double high, int count) {
  std::vector<double> grid;
  for (int i = 0; i < count; ++i) {
    const double share = (i + 0.5) / count;
    grid.push_back(axis.logarithmic ? low * std::pow(high / low, share) : low + (high - low) * share);
  }
  return grid;
}

/// Signatures of a rival over its numbers.
std::vector<VectorXd> signatures_of(const TwinBench& bench, const VectorXd& healthy_psi, const Rival& rival) {
  std::vector<VectorXd> found;
  const Axis& size = rival.axes[0];
  const std::vector<double> seconds = rival.axes.size() > 1
                                          ? grid_of(rival.axes[1], rival.axes[1].low, rival.axes[1].high, kSeconds)
                                          : std::vector<double>{0};
  for (const double first : grid_of(size, size.low, size.high, kSizes))
    for (const double second : seconds) {
      const std::vector<double> values =
          rival.axes.size() > 1 ? std::vector<double>{first, second} : std::vector<double>{first};
      std::vector<stand::Faults> faults = healthy(bench);
      for (stand::Faults& one : faults) rival.apply(values, bench.unit(), one);
      found.push_back(bench.output(bench.unit(), faults) - healthy_psi);
    }
  return found;
}

/// A change of gain from an instant of one recording on.
std::vector<VectorXd> signatures_of_contacts(const TwinBench& bench, const VectorXd& healthy_psi) {
  std::vector<VectorXd> found;
  for (std::size_t i = 0; i < bench.recordings(); ++i)
    for (Index row = 0; row < bench.size(i) - kInstants; row += kInstants)
      found.push_back(gain_changed_from(bench, healthy_psi, i, row));
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

SearchOf of_tone(const std::string& cause, const TwinBench& bench, double places, double causes) {
  const Tone tone(bench);
  SearchOf found{cause, {}, {}};
  for (std::size_t a = 0; a < kAlarms.size(); ++a) {
    found.threshold[a] = root_of_falling([&](double z) { return places * tone.tail(z) - kAlarms[a] / causes; }, 1, 30);
    found.d90[a] = tone.seen_at(found.threshold[a]);
  }
  return found;
}

double longest_s(const TwinBench& bench) {
  double longest = 0;
  for (std::size_t i = 0; i < bench.recordings(); ++i)
    longest = std::max(longest, static_cast<double>(bench.size(i)) * bench.commands()[i].period_s);
  return longest;
}

}  // namespace

std::vector<SearchOf> oracle(const std::vector<std::string>& tests) {
  constexpr Index kDraws = 1'000'000, kDrawsOfContacts = 200'000;
  const TwinBench bench = nominal_bench(tests);
  const Absorption baseline(bench);
  const VectorXd healthy_psi = bench.output(bench.unit(), healthy(bench));
  const auto causes = static_cast<double>(simulated_rivals().size() + kOutputCauses);
  std::vector<SearchOf> found;
  for (const Rival& rival : simulated_rivals())
    found.push_back(
        by_drawing(rival.cause, directions(baseline, signatures_of(bench, healthy_psi, rival)), causes, kDraws, false));
  const auto search_columns = [&](const std::string& cause, const std::vector<VectorXd>& columns, Index draws) {
    found.push_back(by_drawing(cause, directions(baseline, columns), causes, draws, true));
  };
  search_columns("sensor_offset", {VectorXd::Ones(bench.samples())}, kDraws);
  search_columns("sensor_drift", {time(bench)}, kDraws);
  search_columns("side_input", {warmth(bench), supply(bench)}, kDraws);
  search_columns("intermittent", signatures_of_contacts(bench, healthy_psi), kDrawsOfContacts);
  const double resolved_s = longest_s(bench);
  found.push_back(of_tone("periodic_disturbance", bench, resolved_s * (45 - 0.5), causes));
  found.push_back(of_tone("self_oscillation", bench, 4 * resolved_s * (20 - 2), causes));
  return found;
}

}  // namespace valvetriage::hidden_effects
