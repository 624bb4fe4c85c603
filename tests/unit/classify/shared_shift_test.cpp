#include "core/classify/shared_shift.h"

#include <gtest/gtest.h>

#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <random>

namespace valvetriage {
namespace {

constexpr int kLots = 4'000;

struct Lots {
  int valves = 12, good_valves = 8;
  double shift = 0;     ///< in standard deviations of a good valve
  double shrunken = 1;  ///< how far an estimate stands from the good valves' mean, of how far the valve does
  int bad = 0;          ///< valves of the lot that are far off
};

/// Share of lots, each against its own freshly learned reference, in which a shift is seen at the level.
double alarms(const Lots& lots, double level = 0.05) {
  std::mt19937 random(4);
  std::normal_distribution<double> normal;
  int seen = 0;
  for (int lot = 0; lot < kLots; ++lot) {
    double sum = 0, squares = 0;
    for (int i = 0; i < lots.good_valves; ++i) {
      const double value = normal(random);
      sum += value;
      squares += value * value;
    }
    const double n = lots.good_valves, mean = sum / n;
    const GoodValves good{
        .mean = mean, .sd = std::sqrt((squares - n * mean * mean) / (n - 1)), .valves = lots.good_valves};
    std::vector<double> values;
    for (int i = 0; i < lots.valves; ++i) {
      const double value = normal(random) + lots.shift + (i < lots.bad ? 20 : 0);
      values.push_back(mean + lots.shrunken * (value - mean));
    }
    seen += shared_shift(values, good)->p_value < level ? 1 : 0;
  }
  return static_cast<double>(seen) / kLots;
}

TEST(SharedShift, RaisesNoMoreFalseAlarmsThanItSaysHoweverFewTheValves) {
  // 4,000 lots: 0.05 is known to 0.0035. Welch's freedoms are an approximation, by a tenth at most.
  for (const int good_valves : {3, 8, 30}) {
    for (const int valves : {3, 5, 12, 60}) {
      const double share = alarms({.valves = valves, .good_valves = good_valves});
      EXPECT_LT(share, 0.055 + 3 * 0.0035) << valves << " valves, " << good_valves << " good ones";
      // A handful of valves cannot tell their own scatter: the test is slow there, and loses little else.
      EXPECT_GT(share, valves >= 12 && good_valves >= 8 ? 0.01 : -1)
          << valves << " valves, " << good_valves << " good ones";
    }
  }
}

TEST(SharedShift, StaysQuietFarOutInTheTailToo) {
  // What is left of 0.05 after paying for ten figures; known to 0.0011.
  EXPECT_LT(alarms({.valves = 12, .good_valves = 8}, 0.005), 0.0055 + 3 * 0.0011);
}

TEST(SharedShift, SeesWhatNoSingleValveShows) {
  // One standard deviation: a single valve so far off is one good valve in three.
  EXPECT_GT(alarms({.valves = 20, .good_valves = 30, .shift = 1}), 0.8);
  EXPECT_GT(alarms({.valves = 20, .good_valves = 8, .shift = 2}), 0.95);
}

TEST(SharedShift, IsNotRaisedByOneBadValve) {
  EXPECT_LT(alarms({.valves = 12, .good_valves = 8, .bad = 1}), 0.055 + 3 * 0.0035);
}

TEST(SharedShift, IsOnlySlowerWhereEstimatesAreDrawnTowardsGoodValves) {
  EXPECT_LT(alarms({.valves = 12, .good_valves = 8, .shrunken = 0.5}), 0.05);
  EXPECT_LT(alarms({.valves = 12, .good_valves = 8, .shift = 1.5, .shrunken = 0.5}),
            alarms({.valves = 12, .good_valves = 8, .shift = 1.5}));
}

TEST(SharedShift, IsWelchsTestForThreeValves) {
  const auto found = shared_shift(std::vector{0.5, 1.0, 1.5}, {.mean = 0, .sd = 0.2, .valves = 4});
  ASSERT_TRUE(found);
  const double a = 0.25 / 3, b = 0.04 / 4;
  EXPECT_NEAR(found->shift, 1, 1e-12);
  EXPECT_NEAR(found->std_error, std::sqrt(a + b), 1e-12);
  EXPECT_NEAR(found->degrees_of_freedom, (a + b) * (a + b) / (a * a / 2 + b * b / 3), 1e-12) << "below 3";
  const boost::math::students_t student(found->degrees_of_freedom);
  EXPECT_NEAR(found->p_value, 2 * boost::math::cdf(student, -1 / found->std_error), 1e-12);
  EXPECT_NEAR(found->ci95[1] - found->ci95[0], 2 * found->std_error * boost::math::quantile(student, 0.975), 1e-12);
  EXPECT_NEAR(found->largest_single, 1.5 / (0.2 * std::sqrt(1.25)), 1e-12);
}

TEST(SharedShift, SaysNothingOfTwoValvesOrOfAFigureThatNeverDiffers) {
  EXPECT_FALSE(shared_shift(std::vector{1.0, 2.0}, {.mean = 0, .sd = 1, .valves = 8}));
  EXPECT_FALSE(shared_shift(std::vector{1.0, 1.0, 1.0}, {.mean = 1, .sd = 0, .valves = 8}));
}

TEST(HolmAdjusted, PaysForEveryFigureTestedAndKeepsTheOrder) {
  const std::vector<double> adjusted = holm_adjusted(std::vector{0.04, 0.001, 0.03, 0.9});
  EXPECT_NEAR(adjusted[1], 0.004, 1e-15);
  EXPECT_NEAR(adjusted[2], 0.09, 1e-15);
  EXPECT_NEAR(adjusted[0], 0.09, 1e-15) << "never below that of a smaller p-value";
  EXPECT_NEAR(adjusted[3], 0.9, 1e-15);
}

}  // namespace
}  // namespace valvetriage
