#include "core/classify/two_groups.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace valvetriage {
namespace {

TEST(FisherExact, IsThePublishedValueOfTheTeaTasting) {
  // Fisher, The Design of Experiments (1935), chapter 2: three of four cups right; one-sided 17 / 70, two-sided 34
  // / 70.
  EXPECT_NEAR(fisher_exact_p_value(3, 1, 1, 3), 34.0 / 70, 1e-12);
  EXPECT_NEAR(fisher_exact_p_value(4, 0, 0, 4), 2.0 / 70, 1e-12);
}

TEST(FisherExact, SaysNothingWhereAMarginIsEmpty) {
  EXPECT_EQ(fisher_exact_p_value(0, 5, 0, 7), 1);
  EXPECT_EQ(fisher_exact_p_value(0, 0, 3, 7), 1);
}

TEST(FisherExact, HoldsForLotsOfTenThousand) {
  EXPECT_LT(fisher_exact_p_value(600, 9400, 300, 9700), 1e-20);
  EXPECT_GT(fisher_exact_p_value(300, 9700, 300, 9700), 0.9);
}

TEST(RankSum, IsTheNormalApproximationWithContinuity) {
  // U = 1 of 4 and 5: |U − 10| − 1/2 = 8.5 over √(4·5·10/12) = 4.082, z = 2.082
  EXPECT_NEAR(rank_sum_p_value(std::vector<double>{1, 2, 3, 5}, std::vector<double>{4, 6, 7, 8, 9}),
              std::erfc(2.0821 / std::sqrt(2)), 1e-4);
}

TEST(RankSum, TellsNothingFromThreeValues) {
  EXPECT_TRUE(std::isnan(rank_sum_p_value(std::vector<double>{1, 2, 3}, std::vector<double>{4, 5, 6, 7})));
}

TEST(RankSum, OfEqualValuesIsOne) {
  EXPECT_EQ(rank_sum_p_value(std::vector<double>(5, 1.0), std::vector<double>(6, 1.0)), 1);
}

TEST(RankSum, IsBelowFivePercentInFivePercentOfEqualGroups) {
  std::mt19937 random(5);
  std::lognormal_distribution<double> errors(2, 1);
  int below = 0;
  constexpr int kTrials = 2000;
  for (int trial = 0; trial < kTrials; ++trial) {
    std::vector<double> a(12), b(20);
    for (double& value : a) value = errors(random);
    for (double& value : b) value = errors(random);
    below += rank_sum_p_value(a, b) < 0.05;
  }
  EXPECT_NEAR(below, 0.05 * kTrials, 4 * std::sqrt(0.05 * 0.95 * kTrials));  // four standard deviations of the count
}

}  // namespace
}  // namespace valvetriage
