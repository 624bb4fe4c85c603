#include "core/analysis/population_covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
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

/// Valves that differ by the gain of their map and were shifted until they agreed at one knot.
Eigen::MatrixXd trimmed_by_a_shift(int count, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd vectors(kParameters + kKnots, count);
  const auto map = [](double x) { return 100 * (1 + std::tanh(5 * (x - 1.5))); };
  const auto slope = [](double x) { return 500 / std::pow(std::cosh(5 * (x - 1.5)), 2); };
  for (int i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < kParameters; ++j) vectors(j, i) = 1 + 0.1 * normal(random);
    const double gain = 0.01 * normal(random), trimmed_at = knots()[10];
    for (Eigen::Index k = 0; k < kKnots; ++k) {
      const double x = knots()[static_cast<std::size_t>(k)];
      vectors(kParameters + k, i) =
          map(x) + gain * (map(x) - map(trimmed_at) * slope(x) / slope(trimmed_at)) + 0.003 * normal(random);
    }
  }
  return vectors;
}

TEST(PopulationCovariance, OfFewValvesThatAreTrimmedAlikeIsNotLostInItsRounding) {
  // Nothing tells how far the shift would take them if no screw had brought them together.
  constexpr double kLeastKnotSpread = 1e-4 * 200, kLeastShare = 0.15;
  struct Draw {
    int valves;
    unsigned seed;
  };
  for (const auto& [count, seed] : {Draw{3, 154}, Draw{2, 385}, Draw{3, 208}}) {
    const Eigen::MatrixXd learned = trimmed_by_a_shift(count, seed);
    const auto covariance = population_covariance(learned, none(), kParameters, knots()).covariance;
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> of_map(covariance.bottomRightCorner(kKnots, kKnots));
    EXPECT_GT(of_map.eigenvalues()(0), 0.9 * kLeastShare * kLeastKnotSpread * kLeastKnotSpread) << seed;
  }
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

/// Valves whose map is shifted here by so much and there by so much, alike over `length_a`.
Eigen::MatrixXd bent_valves(int count, double length_a, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  Eigen::MatrixXd vectors = valves(count, random);
  for (int i = 0; i < count; ++i) {
    std::vector<double> sines, cosines;
    for (int harmonic = 0; harmonic < 6; ++harmonic) {
      sines.push_back(normal(random));
      cosines.push_back(normal(random));
    }
    for (Eigen::Index k = 0; k < kKnots; ++k) {
      const double at = knots()[static_cast<std::size_t>(k)] - 1.45;
      double shift = 0;
      for (std::size_t harmonic = 0; harmonic < 6; ++harmonic) {
        const double angle = (0.5 + 0.4 * static_cast<double>(harmonic)) * at / length_a;
        shift += 0.002 / std::sqrt(6) * (sines[harmonic] * std::sin(angle) + cosines[harmonic] * std::cos(angle));
      }
      vectors(kParameters + k, i) += 300 / std::pow(std::cosh(3 * at), 2) * shift;
    }
  }
  return vectors;
}

TEST(PopulationCovariance, HowFarAMapBendsAlikeIsLearned) {
  // A step of the map between two neighbours, a narrow dead band, is the stranger the longer good valves bend alike.
  const auto strangeness_of_a_step = [](double length_a) {
    std::mt19937_64 random(14);
    const Eigen::MatrixXd covariance =
        population_covariance(bent_valves(12, length_a, random), none(), kParameters, knots()).covariance;
    Eigen::VectorXd step = Eigen::VectorXd::Zero(covariance.rows());
    step.tail(kKnots / 2).setConstant(1.0);
    return step.dot(covariance.llt().solve(step));
  };
  EXPECT_GT(strangeness_of_a_step(0.3), 2 * strangeness_of_a_step(0.06));
}

TEST(PopulationCovariance, ValvesThatAreSetAlikeAtOnePointDifferByWhatTheyDoThere) {
  // Gains differ by 4 %, and a screw has made up for it at the tenth knot: offset and gain alone would both be wide.
  constexpr Eigen::Index kTrim = 10;
  for (unsigned seed = 1; seed <= 4; ++seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    Eigen::MatrixXd learned = valves(8, random);
    Eigen::VectorXd true_sd(kKnots);
    const auto nominal = [](Eigen::Index k) {
      return 100 * (1 + std::tanh(3 * (knots()[static_cast<std::size_t>(k)] - 1.45)));
    };
    for (Eigen::Index k = 0; k < kKnots; ++k) true_sd(k) = 0.04 * std::abs(nominal(k) - nominal(kTrim));
    for (int i = 0; i < 8; ++i) {
      const double gain = 0.04 * normal(random);
      for (Eigen::Index k = 0; k < kKnots; ++k) {
        learned(kParameters + k, i) = nominal(k) + gain * (nominal(k) - nominal(kTrim)) + 0.05 * normal(random);
      }
    }
    const Eigen::VectorXd sd =
        population_covariance(learned, none(), kParameters, knots()).covariance.diagonal().tail(kKnots).cwiseSqrt();
    EXPECT_LT(sd(kTrim), 0.3) << seed;
    // Known from eight: half to twice.
    for (const Eigen::Index k : {Eigen::Index{0}, Eigen::Index{20}, kKnots - 1}) {
      EXPECT_GT(sd(k), true_sd(k) / 2.2) << seed << ' ' << k;
      EXPECT_LT(sd(k), true_sd(k) * 2.2) << seed << ' ' << k;
    }
  }
}

TEST(PopulationCovariance, ThreeValvesAreEnoughForAPositiveOne) {
  std::mt19937_64 random(12);
  const Eigen::LLT<Eigen::MatrixXd> factor(
      population_covariance(valves(3, random), none(), kParameters, knots()).covariance);
  EXPECT_EQ(factor.info(), Eigen::Success);
}

}  // namespace
}  // namespace valvetriage
