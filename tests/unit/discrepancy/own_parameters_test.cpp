#include "core/discrepancy/own_parameters.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "core/analysis/population_covariance.h"

namespace valvetriage {
namespace {

constexpr Eigen::Index kOwn = static_cast<Eigen::Index>(kValveParameters.size());
constexpr double kMapError_psi = 0.1;  // of a fitted knot

/// Good valves of one type as a learned reference has them: parameters and maps with the errors of their fits.
class GoodValves {
 public:
  explicit GoodValves(std::uint64_t seed) : random_(seed) {
    for (int k = 0; k < 40; ++k) knots_.push_back(1 + 0.025 * k);
  }

  Eigen::MatrixXd fitted(int count) {
    Eigen::MatrixXd vectors(kOwn + static_cast<Eigen::Index>(knots_.size()), count);
    for (int i = 0; i < count; ++i) {
      for (Eigen::Index j = 0; j < kOwn; ++j) vectors(j, i) = 1 + 0.05 * normal_(random_);
      const double shift_a = 0.003 * normal_(random_), gain = 1 + 0.008 * normal_(random_);
      for (std::size_t k = 0; k < knots_.size(); ++k) {
        const double map_psi = gain * 100 * (1 + std::tanh(5 * (knots_[k] + shift_a - 1.5)));
        vectors(kOwn + static_cast<Eigen::Index>(k), i) = map_psi + std::hypot(0.05, kMapError_psi) * normal_(random_);
      }
    }
    return vectors;
  }

  /// A reference of so many of them.
  ValveDiagnosisOptions learned(int count) {
    const Eigen::MatrixXd vectors = fitted(count);
    const Eigen::VectorXd errors = errors_of_a_fit();
    const Eigen::MatrixXd variances = errors.cwiseAbs2().asDiagonal();
    ValveDiagnosisOptions options{.fit = {}, .good_valves = count, .causes = {}, .leftovers = {}};
    options.fit.knots = knots_;
    options.fit.prior = population_prior(vectors.rowwise().mean(),
                                         population_covariance(vectors, variances, kOwn, knots_).covariance, count);
    return options;
  }

  Eigen::VectorXd errors_of_a_fit() const {
    Eigen::VectorXd errors = Eigen::VectorXd::Zero(kOwn + static_cast<Eigen::Index>(knots_.size()));
    errors.tail(static_cast<Eigen::Index>(knots_.size())).setConstant(kMapError_psi);
    return errors;
  }

 private:
  std::vector<double> knots_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

// Over many references: a single one whose valves happen to be alike somewhere accuses several times as many.
TEST(OwnParameters, AccuseNoMoreGoodValvesThanTheySay) {
  constexpr int kReferences = 60, kNew = 60;
  for (const int good_valves : {3, 8}) {
    GoodValves valves(17);
    std::vector<double> p_values;
    for (int reference = 0; reference < kReferences; ++reference) {
      const ValveDiagnosisOptions options = valves.learned(good_valves);
      const Eigen::MatrixXd fresh = valves.fitted(kNew);
      for (int i = 0; i < kNew; ++i) {
        p_values.push_back(own_parameters_of(fresh.col(i), valves.errors_of_a_fit(), options).p_value);
      }
    }
    const auto share_below = [&](double p) {
      return static_cast<double>(std::ranges::count_if(p_values, [&](double at) { return at < p; })) /
             static_cast<double>(p_values.size());
    };
    EXPECT_LT(share_below(0.05), 0.06) << good_valves;
    EXPECT_LT(share_below(0.0025), 0.0050) << good_valves;
    EXPECT_GT(share_below(0.05), 0.005) << good_valves;  // nor is it blind
  }
}

}  // namespace
}  // namespace valvetriage
