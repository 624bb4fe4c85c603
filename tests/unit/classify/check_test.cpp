#include "core/classify/check.h"

#include <gtest/gtest.h>

#include "server/wire/rule_base_json.h"
#include "tests/unit/classify/table_one.h"

namespace valvetriage {
namespace {

using Kind = RuleBaseFinding::Kind;

RuleBase paper() {
  return embedded_rule_base("paper").value();
}

struct Interval {
  Kind kind;
  std::string level;
  double from, to;
};

void expect_findings(const RuleBase& base, const std::vector<Interval>& expected) {
  const auto findings = check_rule_base(base);
  ASSERT_EQ(findings.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_EQ(findings[i].kind, expected[i].kind) << findings[i].text;
    EXPECT_EQ(findings[i].level, expected[i].level) << findings[i].text;
    EXPECT_NEAR(findings[i].from, expected[i].from, 1e-9) << findings[i].text;  // crossings in double arithmetic
    EXPECT_NEAR(findings[i].to, expected[i].to, 1e-9) << findings[i].text;
    EXPECT_FALSE(findings[i].is_fault());
  }
}

TEST(CheckRuleBase, FindsNothingInCalibrated) {
  EXPECT_TRUE(check_rule_base(test::calibrated()).empty());
}

TEST(CheckRuleBase, SaysExactlyWhereThePaperIsNotMonotoneAndWhereItsPartsDisagree) {
  // The first two sets cross at 0.65, the last two at 1.55, the middle two at 1.14 (Eq 22); 1.065, 1.535, 0.923 are
  // Eq 23.
  expect_findings(paper(), {{Kind::kMembershipNotMonotone, "low", 0.65, 0.9},
                            {Kind::kConclusionDisagrees, "low", 1.065, 1.14},
                            {Kind::kConclusionDisagrees, "low", 1.535, 1.55},
                            {Kind::kMembershipNotMonotone, "high", 0.65, 0.9},
                            {Kind::kMembershipNotMonotone, "high", 1.3, 1.55},
                            {Kind::kConclusionDisagrees, "high", 0.923, 1.14}});
}

TEST(CheckRuleBase, AcceptsBothThatComeWithTheProduct) {
  EXPECT_TRUE(require_sound(paper()));
  EXPECT_TRUE(require_sound(test::calibrated()));
}

TEST(CheckRuleBase, FindsAHoleBetweenTwoSets) {
  RuleBase base = test::calibrated();
  auto& sets = base.levels[0].inputs[0].sets;
  sets[0].shape = left_trapezoid(0.9, 1.0);
  sets[1].shape = {1.2, 1.25, 1.27, 1.6};
  const auto sound = require_sound(base);
  ASSERT_FALSE(sound);
  EXPECT_EQ(sound.error().code, "rule_base_uncovered");
  const auto findings = check_rule_base(base);
  EXPECT_NEAR(findings.at(0).from, 1.0, 1e-9);
  EXPECT_NEAR(findings.at(0).to, 1.2, 1e-9);
}

TEST(CheckRuleBase, FindsATouchingPairOfSetsWhereNothingFiresAtOnePoint) {
  RuleBase base = test::calibrated();
  auto& sets = base.levels[0].inputs[0].sets;
  sets[0].shape = left_trapezoid(0.9, 1.1);
  sets[1].shape = {1.1, 1.25, 1.27, 1.6};
  EXPECT_EQ(require_sound(base).error().code, "rule_base_uncovered");
}

TEST(CheckRuleBase, FindsAWorseErrorWithABetterVerdict) {
  RuleBase base = test::calibrated();
  base.levels[0].rules[2].then = Verdict::kGood;
  const auto sound = require_sound(base);
  ASSERT_FALSE(sound);
  EXPECT_EQ(sound.error().code, "rule_base_not_monotone");
}

TEST(CheckRuleBase, FindsAWorseRiseTimeWithABetterVerdict) {
  RuleBase base = test::calibrated();
  LevelRules& level = base.levels[0];
  level.inputs.push_back(
      {Quantity::kRiseTime, {{"fast", left_trapezoid(0.1, 0.2)}, {"slow", right_trapezoid(0.1, 0.2)}}});
  std::vector<Rule> rules;
  for (const Rule& rule : level.rules) {
    rules.push_back({{rule.sets[0], 0}, Verdict::kSevere});
    rules.push_back({{rule.sets[0], 1}, rule.then});
    rules.push_back({{rule.sets[0], std::nullopt}, rule.then});
  }
  level.rules = rules;
  ASSERT_TRUE(validate(base));
  const auto sound = require_sound(base);
  ASSERT_FALSE(sound);
  EXPECT_EQ(sound.error().code, "rule_base_not_monotone");
  EXPECT_NE(sound.error().message.find("rise_time_s"), std::string::npos);
}

}  // namespace
}  // namespace valvetriage
