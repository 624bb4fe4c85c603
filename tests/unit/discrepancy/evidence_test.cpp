#include "core/discrepancy/evidence.h"

#include <gtest/gtest.h>

#include <array>
#include <numbers>
#include <random>

namespace valvetriage {
namespace {

Stack noise(double memory, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Eigen::VectorXd column(8000);
  double state = 0;
  for (Eigen::Index i = 0; i < column.size(); ++i) {
    state = memory * state + std::sqrt(1 - memory * memory) * normal(random);
    column(i) = state;
  }
  return {column};
}

TEST(Evidence, WhiteNoiseIsNotInflated) {
  // Block sums of 125 blocks of 64 samples scatter by √(2/125) = 13 %; three of that.
  EXPECT_LT(noise_inflation(noise(0, 1)), 1.4);
  EXPECT_GE(noise_inflation(noise(0, 1)), 1.0);
}

TEST(Evidence, ColouredNoiseIsInflatedByItsCorrelationTime) {
  // A first-order process of memory a sums up to (1 + a) / (1 − a) times white noise, less at the ends of 64 samples.
  const double long_run = (1 + 0.8) / (1 - 0.8);
  EXPECT_NEAR(noise_inflation(noise(0.8, 2)), long_run, 0.4 * long_run);
}

/// A signature of 20 samples each second of ten seconds, on top of `after`.
Stack with_signature(Stack after, double size) {
  for (Eigen::Index i = 0; i < after[0].size(); ++i) after[0](i) += i % 200 < 20 ? size : 0.0;
  return after;
}

TEST(Evidence, InWhiteNoiseASignatureIsWorthItsEnergy) {
  const Stack after = noise(0, 4);
  const double energy = 800 * 0.5 * 0.5;
  EXPECT_NEAR(consistent_evidence(with_signature(after, 0.5), after, energy).value, energy, 0.3 * energy);
}

TEST(Evidence, WhereTheNoiseIsLoudJustThereASignatureIsWorthLess) {
  Stack after = noise(0, 4);
  for (Eigen::Index i = 0; i < after[0].size(); ++i) after[0](i) *= i % 200 < 20 ? 5 : 1;
  const double energy = 800 * 0.5 * 0.5;
  EXPECT_NEAR(consistent_evidence(with_signature(after, 0.5), after, energy).value, energy / 25, 0.4 * energy / 25);
}

TEST(Evidence, ThePriorDoesNotVouchForASignatureThatLoudNoiseCouldMake) {
  Stack after = noise(0, 4);
  for (Eigen::Index i = 0; i < after[0].size(); ++i) after[0](i) *= i % 200 < 20 ? 5 : 1;
  const double energy = 800 * 0.5 * 0.5;
  EXPECT_LT(consistent_evidence(with_signature(after, 0.5), after, 1.2 * energy).value, 0.1 * energy);
}

TEST(Evidence, WhatTheReductionOwesToThePriorHasNoNoiseInIt) {
  const Stack after = noise(0, 4);
  EXPECT_NEAR(consistent_evidence(after, after, 70).value, 70, 1e-9);
}

TEST(Evidence, WhereTheSamplesHardlyChangeThePriorSpeaksAloneHoweverLoudTheyAre) {
  // A delay that the valve's own delay had taken: the law moves the samples a little, where the simulation is wrong.
  Stack after = noise(0, 4);
  for (Eigen::Index i = 0; i < after[0].size(); ++i) {
    if (i % 200 < 20) after[0](i) = i % 2 == 0 ? 20 : -20;
  }
  const Stack before = with_signature(after, 0.07);
  EXPECT_GT(consistent_evidence(before, after, 50).value, 40);
}

TEST(Evidence, ASlowSignatureIsWorthLittleWhereWhatIsLeftIsAsSlow) {
  // What is left swings once in 4,000 samples, as the signature does: blocks of 256 see one side of a swing each and
  // take it for scatter that averages out.
  Stack after = noise(0, 4), before = after;
  for (Eigen::Index i = 0; i < after[0].size(); ++i) {
    const double angle = 2 * std::numbers::pi * static_cast<double>(i) / 4000;
    after[0](i) += (i < 4000 ? 2 : -2) * std::sin(angle);
    before[0](i) = after[0](i) + 0.5 * std::sin(angle);
  }
  const double energy = 8000 * 0.5 * 0.5 / 2;
  const double as_if_fast = consistent_evidence(before, after, energy).value;
  const double as_slow = consistent_evidence(before, after, energy, 4000).value;
  EXPECT_LT(as_slow, 0.2 * as_if_fast);
  EXPECT_LT(as_slow, 1);
}

TEST(Evidence, ASlowSignatureInWhiteNoiseIsWorthItsEnergy) {
  const Stack after = noise(0, 4);
  Stack before = after;
  for (Eigen::Index i = 0; i < after[0].size(); ++i) {
    before[0](i) += 0.2 * std::sin(2 * std::numbers::pi * static_cast<double>(i) / 400);
  }
  const double energy = 8000 * 0.2 * 0.2 / 2;
  EXPECT_NEAR(consistent_evidence(before, after, energy, 400).value, energy, 0.4 * energy);
}

TEST(Evidence, ASlowSignatureThatScattersFromRecordingToRecordingIsWorthStudentsT) {
  // A level for each of four recordings: of their mean Student's t with three degrees of freedom is all there is to
  // say.
  const Eigen::Index samples = 1000;
  const std::array<double, 4> levels{10, 20, 15, 19};
  const double mean = 16, squares = 36 + 16 + 1 + 9;
  Stack before, after;
  for (const double level : levels) {
    before.push_back(Eigen::VectorXd::Constant(samples, level));
    after.push_back(Eigen::VectorXd::Constant(samples, level - mean));
  }
  const double energy = 4 * samples * mean * mean;
  const Evidence found = consistent_evidence(before, after, energy, samples);
  EXPECT_NEAR(found.value, mean * mean / (squares / 3 / 4), 1e-6);
  EXPECT_NEAR(found.freedoms, 3, 0.1);
}

TEST(Evidence, OneRecordingDoesNotTellHowFarASlowSignatureScatters) {
  const Stack after = noise(0, 4);
  Stack before = after;
  for (Eigen::Index i = 0; i < before[0].size(); ++i) before[0](i) += 1e-4 * static_cast<double>(i - 4000);
  const double energy = (before[0] - after[0]).squaredNorm();
  const Evidence fast = consistent_evidence(before, after, energy);
  const Evidence slow = consistent_evidence(before, after, energy, before[0].size());
  EXPECT_GT(fast.as_normal(), 200);
  EXPECT_EQ(slow.value, fast.value);
  EXPECT_LT(slow.as_normal(), 10);
}

TEST(Evidence, NeitherDoTwoThatScatterLittleBeyondWhiteNoise) {
  // The two levels lie 0.06 apart: their scores scatter by 1.8 times what white noise would make of them.
  const Eigen::Index samples = 1000;
  const Stack before{Eigen::VectorXd::Constant(samples, 10.03), Eigen::VectorXd::Constant(samples, 9.97)};
  const Stack after{Eigen::VectorXd::Constant(samples, 0.03), Eigen::VectorXd::Constant(samples, -0.03)};
  EXPECT_EQ(consistent_evidence(before, after, 2 * samples * 100, samples).freedoms, 1);
}

TEST(Evidence, AContrastInWhiteNoiseIsTheLikelihoodRatio) {
  const Stack truth = noise(0, 5);
  const Contrast better = contrast(truth, with_signature(truth, 0.5));
  EXPECT_NEAR(2 * better.z * better.z, 0.5 * better.difference, 0.4 * better.difference);
  EXPECT_LT(contrast(with_signature(truth, 0.5), truth).z, 0);
}

TEST(Evidence, AContrastThatOnePlaceMakesAndAnotherDeniesIsNone) {
  Stack winner = noise(0, 6), rival = winner;
  rival[0].segment(1000, 100).array() += 3;   // the winner is right here,
  winner[0].segment(5000, 100).array() += 2;  // and wrong there
  const Contrast found = contrast(winner, rival);
  EXPECT_GT(found.difference, 300);
  EXPECT_LT(found.z, 1);
}

TEST(Evidence, NoiseAlongADifferenceIsThatOfWhiteNoiseUnlessTheWinnerErrsAlongIt) {
  const Stack white = noise(0, 5);
  EXPECT_LT(noise_along(white, with_signature(white, 0.5)), 2);
  EXPECT_EQ(noise_along(white, white), 1);
  // Half of the signature is in what the winner leaves as well, its sign the same all over a block.
  const Stack winner = with_signature(white, 0.5), rival = with_signature(white, 1);
  EXPECT_GT(noise_along(winner, rival), 5);
}

TEST(Evidence, AGainIsBorneOutWhereItsContrastReachesWhatIsAsked) {
  // In white noise, spread over many blocks, z is d / 2.
  EXPECT_NEAR(gain_to_be_borne_out({}, 2.5, 5, 1e9, 1), 25, 1e-3);
  EXPECT_GT(gain_to_be_borne_out({}, 2.5, 5, 1e9, 4), 49);
  EXPECT_GT(gain_to_be_borne_out({}, 2.5, 5, 256, 1), 60);  // in one block
  // What is known counts, for the rival too.
  EXPECT_LT(gain_to_be_borne_out({.difference = 100, .z = 5}, 2.5, 5, 1e9, 1), 0);
  EXPECT_GT(gain_to_be_borne_out({.difference = -100, .z = -5}, 2.5, 5, 1e9, 1), 125);
}

TEST(Evidence, NoiseAloneIsNoCause) {
  // χ² of one degree: a reduction of 3.84 has five per cent, were the spread of good valves known.
  EXPECT_NEAR(good_valve_p_value(Evidence{3.84}, 1, 1, {.mean = 0, .valves = 100000}), 0.05, 0.001);
  // F of 1 and 8: eight valves that show nothing do not say that none ever does.
  EXPECT_NEAR(good_valve_p_value(Evidence{5.32}, 1, 1, {.mean = 0, .valves = 8}), 0.05, 0.001);
}

TEST(Evidence, WhatGoodValvesShowAsWellNeedsMoreOfIt) {
  const double strict = good_valve_p_value(Evidence{60}, 1, 1, {.mean = 0, .valves = 8});
  const double with_spread = good_valve_p_value(Evidence{60}, 1, 1, {.mean = 20, .valves = 8});
  EXPECT_LT(strict, 1e-4);
  EXPECT_GT(with_spread, 0.05);
  // The same mean over many valves is known better.
  EXPECT_LT(good_valve_p_value(Evidence{600}, 1, 1, {.mean = 20, .valves = 30}),
            good_valve_p_value(Evidence{600}, 1, 1, {.mean = 20, .valves = 3}));
}

TEST(Evidence, WhatEveryGoodValveShowsAlikeIsKnownBetter) {
  const auto p_value = [](double sd) {
    return good_valve_p_value(Evidence{600}, 1, 1, {.mean = 30, .sd = sd, .valves = 8});
  };
  // The square of a normal deviate scatters by √2 of its mean; half of such samples of eight scatter by less.
  EXPECT_NEAR(p_value(std::sqrt(2.0) * 30), p_value(0), 0.3 * p_value(0));
  EXPECT_NEAR(p_value(0.9 * std::sqrt(2.0) * 30), p_value(0), 0.5 * p_value(0));
  EXPECT_LT(p_value(10), 0.03 * p_value(0));
}

TEST(Evidence, ThreeGoodValvesThatHappenToBeAlikeDoNotSayThatAllAre) {
  const auto p_value = [](int valves) {
    return good_valve_p_value(Evidence{106}, 2, 11, {.mean = 21, .sd = 3, .valves = valves});
  };
  EXPECT_GT(p_value(3), 1e-3);
  EXPECT_LT(p_value(30), 1e-6);
}

TEST(Evidence, OfSquaresWhoseScatterIsNotKnownTheOneIsLikeTheNextNormalDeviates) {
  EXPECT_NEAR(square_p_value(5.32, 1, 0, 8), 0.05, 0.001);        // F of 1 and 8
  EXPECT_NEAR(square_p_value(5.32, 1, 0.01, 2), 0.15, 0.01);      // two tell no scatter: F of 1 and 2
  EXPECT_NEAR(square_p_value(5.32, 1, 1e-9, 8, 1), 0.05, 0.001);  // however alike, no more freedoms than there may be
}

TEST(Evidence, ASearchOverManyStartsIsPaidFor) {
  EXPECT_GT(good_valve_p_value(Evidence{14}, 2, 14, {.mean = 0, .valves = 8}), 0.1);
  EXPECT_LT(good_valve_p_value(Evidence{14}, 2, 2, {.mean = 0, .valves = 8}), 0.01);
}

TEST(Evidence, WhereNothingIsSeenAFaultTooSmallToSeeKeepsItsOdds) {
  EXPECT_NEAR(odds_at_unknown_size(1), 0.18, 0.01);  // E₁(1/8) / (2 ln 100)
  EXPECT_EQ(odds_at_unknown_size(1), odds_at_unknown_size(0.5));
  EXPECT_NEAR(odds_at_unknown_size(0.023), 2.3, 0.3);  // two deviations
  EXPECT_GT(odds_at_unknown_size(1e-5), 100);
  EXPECT_TRUE(std::isfinite(odds_at_unknown_size(0)));
}

TEST(Evidence, ASizeIsJudgedAgainstGoodValvesSpread) {
  // 4.8 psi where good valves lie at 0.5 ± 0.2 and the error is negligible: t of 20 with seven degrees of freedom.
  EXPECT_LT(size_p_value(4.8, 0.5, 0.2, 0.005, 0, 8), 1e-6);
  EXPECT_GT(size_p_value(0.8, 0.5, 0.2, 0.005, 0, 8), 0.1);
  EXPECT_EQ(size_p_value(0.8, 0.5, 0.2, std::numeric_limits<double>::infinity(), 0, 8), 1.0);
}

TEST(Evidence, ASizeWhoseErrorIsWideIsJudgedByThatError) {
  // Ten errors from good valves that are all alike: a normal deviate. Four are not enough for one law of
  // twenty at a false alarm in two hundred where the spread of eight valves is as wide as the error.
  EXPECT_LT(size_p_value(5, 0, 0.05, 0.5, 0, 8), 1e-15);
  EXPECT_GT(size_p_value(4, 0, 0.7, 0.7, 0, 8), 2.5e-4);
}

TEST(Evidence, AnErrorThatThePriorTellsIsKnownFromGoodValvesAlone) {
  // Five errors out in what the valve's own parameters may make as well: rare where samples tell so, not rare enough
  // for one law of twenty where the spread of eight valves does.
  EXPECT_LT(size_p_value(5, 0, 0.1, 1, 0, 8), 1e-6);
  EXPECT_GT(size_p_value(5, 0, 0.1, 1, 1, 8), 1e-3);
  EXPECT_LT(size_p_value(12, 0, 0.1, 1, 1, 8), 1e-5);
}

TEST(Evidence, SquaresOfSizesOnBothSidesOfNoneScatterLikeANormalDeviates) {
  // Eight good valves whose evidence happens to be alike, their sizes on either side of none: one of them may well be
  // five times as far out. Where all of them lie on one side, that is far more than any.
  const auto p = [](double common_size) {
    return good_valve_p_value(Evidence{100}, 1, 1, {.mean = 5, .sd = 2, .valves = 8, .common_size = common_size});
  };
  EXPECT_GT(p(0), 1e-3);
  EXPECT_LT(p(4), 1e-5);
  EXPECT_EQ(p(1e9), p(std::numeric_limits<double>::infinity()));
}

}  // namespace
}  // namespace valvetriage
