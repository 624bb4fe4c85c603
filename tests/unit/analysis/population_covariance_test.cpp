#include "core/analysis/population_covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <random>

namespace valvetriage {
namespace {

constexpr Eigen::Index kParameters = 3, kKnots = 30;

std::vector<double> knots() {
  std::vector<double> inputs;
  for (Eigen::Index k = 0; k < kKnots; ++k) inputs.push_back(1.0 + 0.03 * static_cast<double>(k));
  return inputs;
}

Eigen::MatrixXd none() {
  return Eigen::MatrixXd::Zero(kParameters + kKnots, kParameters + kKnots);
}

/// Valves that differ by their parameters and by shift and gain of a smooth map.
Eigen::MatrixXd valves(int count, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd vectors(kParameters + kKnots, count);
  for (int i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < kParameters; ++j) vectors(j, i) = 1 + 0.1 * normal(random);
    const double shift = 0.003 * normal(random), gain = 1 + 0.01 * normal(random);
    for (Eigen::Index k = 0; k < kKnots; ++k) {
      const double x = knots()[static_cast<std::size_t>(k)] + shift - 1.45;
      vectors(kParameters + k, i) = gain * 100 * (1 + std::tanh(3 * x)) + 0.05 * normal(random);
    }
  }
  return vectors;
}

TEST(PopulationCovariance, ANewGoodValveIsAsFarAsItClaims) {
  std::mt19937_64 random(11);
  double squares = 0;
  int seen = 0;
  for (int repeat = 0; repeat < 12; ++repeat) {
    const Eigen::MatrixXd learned = valves(8, random);
    const Eigen::MatrixXd covariance =
        (1 + 1 / 8.0) * population_covariance(learned, none(), kParameters, knots()).covariance;
    const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
    ASSERT_EQ(factor.info(), Eigen::Success);
    const Eigen::VectorXd mean = learned.rowwise().mean();
    const Eigen::MatrixXd fresh = valves(10, random);
    for (Eigen::Index i = 0; i < fresh.cols(); ++i, ++seen) {
      squares += factor.matrixL().solve(fresh.col(i) - mean).squaredNorm() / static_cast<double>(fresh.rows());
    }
  }
  // Each of 33 rows contributes one in the mean; a covariance known from eight valves is off by a factor of two at
  // most.
  EXPECT_GT(squares / seen, 0.4);
  EXPECT_LT(squares / seen, 2.0);
}

TEST(PopulationCovariance, WhatTheEstimatesErrByIsNoDifferenceBetweenValves) {
  std::mt19937_64 random(13);
  std::normal_distribution<double> normal;
  constexpr double kError_psi = 0.5;
  Eigen::MatrixXd learned = valves(8, random);
  for (Eigen::Index k = 0; k < kKnots; ++k) {
    for (Eigen::Index i = 0; i < learned.cols(); ++i) learned(kParameters + k, i) += kError_psi * normal(random);
  }
  Eigen::MatrixXd errors = none();
  errors.diagonal().tail(kKnots).setConstant(kError_psi * kError_psi);
  // How much neighbours may differ: the second differences of a map.
  const auto roughness = [](const Eigen::MatrixXd& covariance) {
    const Eigen::Index k = kParameters + kKnots / 2;
    Eigen::VectorXd bend = Eigen::VectorXd::Zero(covariance.rows());
    bend.segment(k, 3) << 1, -2, 1;
    return std::sqrt(bend.dot(covariance * bend));
  };
  EXPECT_GT(roughness(population_covariance(learned, none(), kParameters, knots()).covariance),
            0.7 * std::sqrt(6) * kError_psi);
  EXPECT_LT(roughness(population_covariance(learned, errors, kParameters, knots()).covariance),
            0.4 * std::sqrt(6) * kError_psi);
}

TEST(PopulationCovariance, ThreeValvesAreEnoughForAPositiveOne) {
  std::mt19937_64 random(12);
  const Eigen::LLT<Eigen::MatrixXd> factor(
      population_covariance(valves(3, random), none(), kParameters, knots()).covariance);
  EXPECT_EQ(factor.info(), Eigen::Success);
}

}  // namespace
}  // namespace valvetriage
