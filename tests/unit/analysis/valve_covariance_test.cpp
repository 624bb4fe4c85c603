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

constexpr Index kFittedParameters = static_cast<Index>(kValveParameters.size());
constexpr Index kFrequency = 0, kDamping = 1, kDelay = 2, kEvenKnots = 20;

std::vector<double> even_knots() {
  std::vector<double> inputs;
  for (Index k = 0; k < kEvenKnots; ++k) inputs.push_back(1.0 + 0.05 * static_cast<double>(k));
  return inputs;
}

/// What the delay has for each unit of ln frequency and of ln damping [s].
struct Along {
  double frequency_s = 0, damping_s = 0;
};

/// Valves that differ by 5 % in frequency and damping, and by 0.4 ms of delay beside what goes with these.
MatrixXd valves(Index count, const Along& along, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  MatrixXd vectors(kFittedParameters + kEvenKnots, count);
  for (Index i = 0; i < count; ++i) {
    for (Index j = 0; j < kFittedParameters; ++j) vectors(j, i) = 1 + 0.05 * normal(random);
    const double frequency = 0.05 * normal(random), damping = 0.05 * normal(random);
    vectors(kFrequency, i) = 5.6 + frequency;
    vectors(kDamping, i) = -0.1 + damping;
    vectors(kDelay, i) = 0.005 + 0.0004 * normal(random) + along.frequency_s * frequency + along.damping_s * damping;
    const double gain = 1 + 0.01 * normal(random);
    for (Index k = 0; k < kEvenKnots; ++k) {
      vectors(kFittedParameters + k, i) =
          150 * gain * even_knots()[static_cast<std::size_t>(k)] + 0.05 * normal(random);
    }
  }
  return vectors;
}

struct Learned {
  double delay_s = 0;        ///< standard deviation beside everything else of a valve, root mean square over the draws
  double delay_squares = 0;  ///< of new valves' delays beside the rest, in what the covariance claims; the mean
};

Learned learned_from(Index count, const Along& along, Index left_out = 0) {
  constexpr int kDraws = 40, kFresh = 10;
  const MatrixXd no_errors = MatrixXd::Zero(kFittedParameters + kEvenKnots, kFittedParameters + kEvenKnots);
  std::mt19937_64 random(17);
  Learned learned;
  for (int draw = 0; draw < kDraws; ++draw) {
    const MatrixXd good = valves(count, along, random);
    const MatrixXd covariance = valve_covariance(good, no_errors, even_knots(), 1, left_out);
    EXPECT_EQ(Eigen::LLT<MatrixXd>(covariance).info(), Eigen::Success);
    const MatrixXd precision = covariance.inverse();
    const double variance = 1 / precision(kDelay, kDelay);
    learned.delay_s += variance / kDraws;
    const MatrixXd fresh = valves(kFresh, along, random).colwise() - good.rowwise().mean();
    for (Index i = 0; i < kFresh; ++i) {
      const double beside = precision.row(kDelay).dot(fresh.col(i)) * variance;
      learned.delay_squares += beside * beside / variance / (kDraws * kFresh);
    }
  }
  learned.delay_s = std::sqrt(learned.delay_s);
  return learned;
}

// 0.4 ms are the delay's own, 0.7 ms go with one of the others: 0.8 ms in all.
constexpr Along kWithDamping{.damping_s = 0.014}, kWithFrequency{.frequency_s = 0.014};

TEST(ValveCovariance, ADelayThatGoesWithTheDampingIsForetoldByIt) {
  EXPECT_LT(learned_from(8, kWithDamping).delay_s, 0.65e-3);
  const Learned thirty = learned_from(30, kWithDamping);
  EXPECT_NEAR(thirty.delay_s, 0.42e-3, 0.05e-3);
  EXPECT_LT(thirty.delay_squares, 1.3);
}

TEST(ValveCovariance, ADelayThatGoesWithTheFrequencyIsForetoldByIt) {
  EXPECT_LT(learned_from(8, kWithFrequency).delay_s, 0.65e-3);
  const Learned thirty = learned_from(30, kWithFrequency);
  EXPECT_NEAR(thirty.delay_s, 0.42e-3, 0.05e-3);
  EXPECT_LT(thirty.delay_squares, 1.3);
}

TEST(ValveCovariance, SevenValvesTellNoSlopeUnlessAnEighthStandsAside) {
  const double seven = learned_from(7, kWithDamping).delay_s, with_eighth = learned_from(7, kWithDamping, 1).delay_s;
  EXPECT_GT(seven, 0.75e-3);
  EXPECT_LT(with_eighth, 0.85 * seven);
}

TEST(ValveCovariance, ADelayThatGoesWithNothingKeepsItsOwnSpread) {
  const Learned eight = learned_from(8, {}), thirty = learned_from(30, {});
  EXPECT_NEAR(eight.delay_s, 0.4e-3, 0.05e-3);
  EXPECT_NEAR(thirty.delay_s, 0.4e-3, 0.03e-3);
  // A variance and a mean from n valves: new ones are (1 + 1/n) (n − 1) / (n − 3) as far as it claims, 1.58 for eight
  // and 1.11 for thirty. Slopes that are chance cost little more.
  EXPECT_LT(eight.delay_squares, 1.4 * 1.58);
  EXPECT_LT(thirty.delay_squares, 1.2 * 1.11);
}

}  // namespace
}  // namespace valvetriage
