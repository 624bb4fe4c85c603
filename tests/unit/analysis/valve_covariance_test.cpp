#include "core/analysis/valve_covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <random>

#include "core/identify/valve_fit.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kParameters = static_cast<Index>(kValveParameters.size());
constexpr Index kDamping = 1, kDelay = 2, kKnots = 20;

std::vector<double> knots() {
  std::vector<double> inputs;
  for (Index k = 0; k < kKnots; ++k) inputs.push_back(1.0 + 0.05 * static_cast<double>(k));
  return inputs;
}

/// Valves whose delay has 0.4 ms of its own beside `along_s` for each unit of ln damping, of which they have 0.05.
MatrixXd valves(int count, double along_s, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  MatrixXd vectors(kParameters + kKnots, count);
  for (int i = 0; i < count; ++i) {
    for (Index j = 0; j < kParameters; ++j) vectors(j, i) = 1 + 0.05 * normal(random);
    vectors(kDelay, i) = 0.005 + 0.0004 * normal(random) + along_s * (vectors(kDamping, i) - 1);
    const double gain = 1 + 0.01 * normal(random);
    for (Index k = 0; k < kKnots; ++k) {
      vectors(kParameters + k, i) = 150 * gain * knots()[static_cast<std::size_t>(k)] + 0.05 * normal(random);
    }
  }
  return vectors;
}

MatrixXd no_errors() {
  return MatrixXd::Zero(kParameters + kKnots, kParameters + kKnots);
}

/// Standard deviation of the delay where everything else of a valve is known.
double delay_beside_others_s(const MatrixXd& covariance) {
  return 1 / std::sqrt(covariance.inverse()(kDelay, kDelay));
}

struct Learned {
  double delay_s = 0;        ///< sd beside the others, root mean square over the draws
  double delay_squares = 0;  ///< of new valves' delays, beside the others, in what the covariance claims; the mean
};

Learned learned_from(int count, double along_s) {
  constexpr int kDraws = 40, kFresh = 10;
  std::mt19937_64 random(17);
  Learned learned;
  for (int draw = 0; draw < kDraws; ++draw) {
    const MatrixXd good = valves(count, along_s, random);
    const MatrixXd covariance = valve_covariance(good, no_errors(), knots());
    EXPECT_EQ(Eigen::LLT<MatrixXd>(covariance).info(), Eigen::Success);
    const double sd = delay_beside_others_s(covariance);
    learned.delay_s += sd * sd / kDraws;
    const MatrixXd precision = covariance.inverse();
    const MatrixXd fresh = valves(kFresh, along_s, random).colwise() - good.rowwise().mean();
    for (Index i = 0; i < kFresh; ++i) {
      const double beside = precision.row(kDelay).dot(fresh.col(i)) / precision(kDelay, kDelay);
      learned.delay_squares += beside * beside / (sd * sd) / (kDraws * kFresh);
    }
  }
  learned.delay_s = std::sqrt(learned.delay_s);
  return learned;
}

TEST(ValveCovariance, ADelayThatGoesWithTheDampingIsForetoldByIt) {
  // 0.4 ms are the delay's own, 0.7 ms go with the damping.
  const Learned eight = learned_from(8, 0.014), thirty = learned_from(30, 0.014);
  EXPECT_LT(eight.delay_s, 0.62e-3);
  EXPECT_LT(thirty.delay_s, 0.47e-3);
  EXPECT_GT(thirty.delay_s, 0.36e-3);
  EXPECT_LT(thirty.delay_squares, 1.3);
}

TEST(ValveCovariance, ThreeValvesTellNoSlope) {
  EXPECT_GT(learned_from(3, 0.014).delay_s, 0.6e-3);
}

TEST(ValveCovariance, ADelayThatGoesWithNothingKeepsItsOwnSpread) {
  const Learned eight = learned_from(8, 0), thirty = learned_from(30, 0);
  EXPECT_NEAR(eight.delay_s, 0.4e-3, 0.05e-3);
  EXPECT_NEAR(thirty.delay_s, 0.4e-3, 0.03e-3);
  // A variance and a mean from n valves: new ones are (1 + 1/n) (n − 1) / (n − 3) as far as it claims, 1.58 for eight
  // and 1.11 for thirty. Slopes that are chance cost little more.
  EXPECT_LT(eight.delay_squares, 1.4 * 1.58);
  EXPECT_LT(thirty.delay_squares, 1.2 * 1.11);
}

}  // namespace
}  // namespace valvetriage
