#include "core/model/test_plan.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>

namespace valvetriage {
namespace {

TestPlan plan_of(PlannedTest test, std::vector<double> levels_psi) {
  TestPlan plan;
  plan.test = test;
  plan.levels_psi = std::move(levels_psi);
  plan.duration_s = 20;
  plan.to_hz = 5;
  return plan;
}

std::vector<double> current_of(const TestPlan& plan) {
  return plan_current(plan, paper_steady_map()).value();
}

std::string refused(const TestPlan& plan) {
  const auto current = plan_current(plan, paper_steady_map());
  return current ? "" : current.error().field + current.error().code;
}

TEST(TestPlan, StepsGoFromRestToEachLevelAndBack) {
  const TestPlan plan = plan_of(PlannedTest::kStep, {26, 120});
  const std::vector<double> current = current_of(plan);
  const auto hold = static_cast<std::size_t>(plan.hold_s * plan.sample_rate_hz);
  ASSERT_EQ(current.size(), 5 * hold);
  const double expected[] = {1.2, 1.4, 1.2, 1.6, 1.2};
  for (std::size_t visit = 0; visit < 5; ++visit) {
    EXPECT_DOUBLE_EQ(current[visit * hold], expected[visit]);
    EXPECT_DOUBLE_EQ(current[(visit + 1) * hold - 1], expected[visit]);
  }
}

TEST(TestPlan, AStaircaseGoesUpAndDownWhateverTheOrderOfItsLevels) {
  const std::vector<double> current = current_of(plan_of(PlannedTest::kStaircase, {120, 3.1, 26}));
  std::vector<double> visits;
  std::unique_copy(current.begin(), current.end(), std::back_inserter(visits));
  ASSERT_EQ(visits.size(), 5u);
  EXPECT_EQ(visits, std::vector<double>(visits.rbegin(), visits.rend()));
  EXPECT_DOUBLE_EQ(visits[2], 1.6);
}

TEST(TestPlan, ATriangleHasOneRateBothWays) {
  const std::vector<double> current = current_of(plan_of(PlannedTest::kTriangle, {26, 120}));
  const double step = current[1] - current[0];
  for (std::size_t i = 1; i < current.size(); ++i) EXPECT_NEAR(std::abs(current[i] - current[i - 1]), step, 1e-12);
  EXPECT_DOUBLE_EQ(*std::max_element(current.begin(), current.end()), 1.6);
}

TEST(TestPlan, WavesStayBetweenTheirLevels) {
  for (const PlannedTest test : {PlannedTest::kSweep, PlannedTest::kMultisine}) {
    const std::vector<double> current = current_of(plan_of(test, {26, 120}));
    const auto [low, high] = std::minmax_element(current.begin(), current.end());
    EXPECT_GE(*low, 1.4 - 1e-12);
    EXPECT_LE(*high, 1.6 + 1e-12);
    // A sample can miss a crest by half a period of the fastest tone over its samples: cos(π 5 / 200) = 0.997.
    EXPECT_GT(*high - *low, 0.2 * 0.99);
  }
}

TEST(TestPlan, AMultisineRepeatsAfterHalfItsDuration) {
  const std::vector<double> current = current_of(plan_of(PlannedTest::kMultisine, {26, 120}));
  const std::size_t half = current.size() / 2;
  for (std::size_t i = 0; i < half; ++i) EXPECT_NEAR(current[i], current[i + half], 1e-9);  // rounding of the phases
}

TEST(TestPlan, TheSeedDecidesThePhasesOfAMultisine) {
  TestPlan plan = plan_of(PlannedTest::kMultisine, {26, 120});
  const auto first = current_of(plan);
  EXPECT_EQ(first, current_of(plan));
  plan.seed = 2;
  EXPECT_NE(first, current_of(plan));
}

TEST(TestPlan, RefusesWhatCannotBePlayedAndNamesTheOption) {
  EXPECT_EQ(refused(plan_of(PlannedTest::kStep, {})), "levels_psibad_plan");
  EXPECT_EQ(refused(plan_of(PlannedTest::kStep, {3.1})), "levels_psibad_plan");
  EXPECT_EQ(refused(plan_of(PlannedTest::kTriangle, {26})), "levels_psibad_plan");
  EXPECT_EQ(refused(plan_of(PlannedTest::kStep, {26, 211})), "level_out_of_range");
  EXPECT_EQ(refused(plan_of(PlannedTest::kStep, {26, 210})), "");
  TestPlan plan = plan_of(PlannedTest::kSweep, {26, 120});
  plan.to_hz = 40;
  EXPECT_EQ(refused(plan), "") << "a fifth of the sample rate is allowed";
  plan.to_hz = 40.1;
  EXPECT_EQ(refused(plan), "to_hzbad_plan");
  plan.to_hz = plan.from_hz;
  EXPECT_EQ(refused(plan), "from_hzbad_plan");
  plan = plan_of(PlannedTest::kStep, {26});
  plan.hold_s = 0;
  EXPECT_EQ(refused(plan), "hold_sbad_plan");
  plan.hold_s = 1e9;
  EXPECT_EQ(refused(plan), "too_large");
  plan.sample_rate_hz = -1;
  EXPECT_EQ(refused(plan), "sample_rate_hzbad_plan");
}

}  // namespace
}  // namespace valvetriage
