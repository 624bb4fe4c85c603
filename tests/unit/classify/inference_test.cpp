#include "core/classify/inference.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <limits>

#include "server/wire/rule_base_json.h"
#include "tests/unit/classify/table_one.h"

namespace valvetriage {
namespace {

constexpr auto kClip = Implication::kMinimum;
constexpr auto kScale = Implication::kProduct;

double centroid(std::vector<FiredSet> fired, Implication implication) {
  return exact_centroid(fired, implication).value();
}

TEST(ExactCentroid, OfATriangleIsTheMeanOfItsCorners) {
  EXPECT_NEAR(centroid({{{0, 1, 1, 5}, 1}}, kClip), 2.0, 1e-14);
  EXPECT_NEAR(centroid({{{0, 1, 1, 5}, 0.3}}, kScale), 2.0, 1e-14);
}

TEST(ExactCentroid, OfAClippedTriangleIsThatOfTheTrapezoidLeft) {
  // Triangle 0, 2, 2 clipped at 1/2: rises to 1/2 at 1, stays to 2. Area 1/4 + 1/2, moments 1/4 * 2/3 + 1/2 * 3/2.
  EXPECT_NEAR(centroid({{{0, 2, 2, 2}, 0.5}}, kClip), (0.25 * 2 / 3 + 0.75) / 0.75, 1e-14);
}

TEST(ExactCentroid, CountsAnOverlapOnce) {
  // Two boxes, [0, 2] at 1 and [1, 3] at 1/2: the second adds [2, 3] at 1/2 alone.
  EXPECT_NEAR(centroid({{{0, 0, 2, 2}, 1}, {{1, 1, 3, 3}, 0.5}}, kClip), (2 * 1 + 0.5 * 2.5) / 2.5, 1e-14);
}

TEST(ExactCentroid, BreaksAtTheCrossingOfTwoSlopes) {
  // Equal triangles mirrored about 1/4.
  EXPECT_NEAR(centroid({{{-0.5, 0, 0, 0.5}, 0.7}, {{0, 0.5, 0.5, 1}, 0.7}}, kClip), 0.25, 1e-14);
  EXPECT_NEAR(centroid({{{-0.5, 0, 0, 0.5}, 0.7}, {{0, 0.5, 0.5, 1}, 0.7}}, kScale), 0.25, 1e-14);
}

TEST(ExactCentroid, IsNothingWhereNothingFires) {
  const FiredSet silent[] = {{{0, 1, 1, 2}, 0}};
  EXPECT_FALSE(exact_centroid(silent, kClip));
  EXPECT_FALSE(exact_centroid({}, kClip));
}

RC_GTEST_PROP(ExactCentroid, LiesInsideTheSupportAndAgreesWithFineSampling, (bool clip)) {
  std::vector<FiredSet> fired;
  double low = 1e9;
  double high = -1e9;
  for (int i = 0; i < 3; ++i) {
    const double a = *rc::gen::inRange(-100, 100) / 10.0;
    const double b = a + *rc::gen::inRange(0, 50) / 10.0;
    const double c = b + *rc::gen::inRange(0, 50) / 10.0;
    const double d = c + *rc::gen::inRange(1, 50) / 10.0;
    fired.push_back({{a, b, c, d}, *rc::gen::inRange(1, 11) / 10.0});
    low = std::min(low, a);
    high = std::max(high, d);
  }
  const double exact = centroid(fired, clip ? kClip : kScale);
  RC_ASSERT(exact > low && exact < high);

  constexpr int kSamples = 20000;
  const double step = (high - low) / kSamples;
  double area = 0;
  double moment = 0;
  for (int i = 0; i < kSamples; ++i) {
    const double z = low + (i + 0.5) * step;
    double height = 0;
    for (const auto& [shape, w] : fired) {
      const double mu = membership(shape, z);
      height = std::max(height, clip ? std::min(w, mu) : w * mu);
    }
    area += height;
    moment += height * z;
  }
  // A vertical edge inside a cell is misplaced by at most half a step; six edges of height 1 against an area of at
  // least half of the narrowest set at its least strength leave some 1e-2 of a unit in the worst case.
  RC_ASSERT(std::abs(exact - moment / area) < 1e-2);
}

TEST(Classify, TakesTheWorseOfTheLevels) {
  const LevelFeatures good_low{.level_a = 1.4, .error_eq20 = 1.0};
  const LevelFeatures severe_high{.level_a = 1.6, .error_eq20 = 1.2};
  const LevelFeatures both[] = {severe_high, good_low};
  const auto result = classify(test::calibrated(), both).value();
  EXPECT_EQ(result.verdict, Verdict::kSevere);
  EXPECT_EQ(result.memberships, (Memberships{0, 0, 1}));
  ASSERT_EQ(result.per_level.size(), 2u);
  EXPECT_EQ(result.per_level[0].verdict, Verdict::kGood);
  EXPECT_EQ(result.per_level[1].verdict, Verdict::kSevere);
}

TEST(Classify, HasNoVerdictWhereALevelIsMissing) {
  const LevelFeatures low[] = {{.level_a = 1.4, .error_eq20 = 1.0}};
  const auto result = classify(test::calibrated(), low).value();
  EXPECT_FALSE(result.verdict);
  EXPECT_EQ(result.reason, Unclassified::kLevelMissing);
  EXPECT_EQ(result.missing_levels, std::vector<std::string>{"high"});
  EXPECT_EQ(result.per_level.size(), 1u);
}

TEST(Classify, MatchesLevelsWithinTheToleranceAndNotBeyond) {
  const RuleBase base = test::calibrated();
  const LevelFeatures inside[] = {{.level_a = 1.4 + 0.9 * kLevelTolerance, .error_eq20 = 1},
                                  {.level_a = 1.6, .error_eq20 = 0.9}};
  const LevelFeatures beyond[] = {{.level_a = 1.4 + 1.1 * kLevelTolerance, .error_eq20 = 1},
                                  {.level_a = 1.6, .error_eq20 = 0.9}};
  EXPECT_TRUE(classify(base, inside)->verdict);
  EXPECT_FALSE(classify(base, beyond)->verdict);
}

TEST(Classify, ReportsTheStrengthOfEveryRuleThatTookPart) {
  const RuleBase base = test::calibrated();
  const auto level = classify_level(base, base.levels[0], {.level_a = 1.4, .error_eq20 = 1.1}).value();
  ASSERT_EQ(level.rules.size(), 3u);
  double sum = 0;
  for (const FiredRule& rule : level.rules) sum += rule.strength;
  EXPECT_NEAR(sum, 1, 1e-12);  // neighbouring sets of a learned base add up to 1
  EXPECT_EQ(level.rules[0].text, "error is good -> Good");
}

TEST(Classify, RefusesAnErrorThatIsNotFinite) {
  const RuleBase base = test::calibrated();
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(classify_level(base, base.levels[0], {.level_a = 1.4, .error_eq20 = nan}).error().code, "not_finite");
  EXPECT_EQ(classify_level(base, base.levels[0], {.level_a = 1.4, .error_eq20 = kOpen}).error().code, "not_finite");
}

TEST(SoftError, IsAConfusionOfTheTwoBadClassesOrAMembershipThatPointsElsewhere) {
  using enum Verdict;
  EXPECT_TRUE(is_soft_error(kMalfunctioned, kSevere, {0, 0, 1}));
  EXPECT_TRUE(is_soft_error(kSevere, kSevere, {0, 0.6, 0.4}));
  EXPECT_FALSE(is_soft_error(kSevere, kSevere, {0, 0.4, 0.6}));
  EXPECT_FALSE(is_soft_error(kGood, kSevere, {0, 0, 1}));
  EXPECT_TRUE(is_hard_error(kGood, kSevere));
  EXPECT_FALSE(is_hard_error(kMalfunctioned, kSevere));
}

}  // namespace
}  // namespace valvetriage
