#include "core/classify/learn.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <limits>
#include <random>

#include "core/classify/check.h"
#include "tests/unit/classify/table_one.h"

namespace valvetriage {
namespace {

/// Valves of three classes whose errors at some levels lie around the given centres with one spread.
struct Population {
  std::vector<double> levels{1.4, 1.6};
  std::array<double, kVerdictCount> centres{1, 2, 3};
  double spread = 0.1;
  int per_class = 8;
};

std::vector<LabelledValve> draw(const Population& population, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::vector<LabelledValve> valves;
  for (const Verdict verdict : kVerdicts) {
    for (int i = 0; i < population.per_class; ++i) {
      LabelledValve valve{.verdict = verdict, .levels = {}};
      for (const double level : population.levels) {
        const double error = std::abs(population.centres[index_of(verdict)] + population.spread * normal(random));
        valve.levels.push_back({.level_a = level, .error_eq20 = error});
      }
      valves.push_back(std::move(valve));
    }
  }
  return valves;
}

void keep_only(std::vector<LabelledValve>& valves, Verdict verdict, std::size_t most) {
  std::size_t seen = 0;
  std::erase_if(valves, [&](const LabelledValve& valve) { return valve.verdict == verdict && ++seen > most; });
}

/// Adds a rise time that grows with the class.
void add_rise_times(std::vector<LabelledValve>& valves) {
  double jitter = 0;
  for (LabelledValve& valve : valves) {
    jitter = jitter > 0.02 ? 0 : jitter + 0.003;
    for (LevelFeatures& level : valve.levels) level.rise_time_s = 0.1 + 0.1 * double(index_of(valve.verdict)) + jitter;
  }
}

TEST(Quantile, InterpolatesBetweenOrderStatistics) {
  EXPECT_DOUBLE_EQ(quantile({3, 1, 2}, 0.5), 2);
  EXPECT_DOUBLE_EQ(quantile({4, 1, 2, 3}, 0.25), 1.75);
  EXPECT_DOUBLE_EQ(quantile({7}, 0.75), 7);
  EXPECT_DOUBLE_EQ(quantile({1, 2}, 1), 2);
}

TEST(LearnRuleBase, CrossesHalfWayBetweenTheQuartilesOfNeighbouringClasses) {
  const auto learned = learn_rule_base(test::table_one(), {}).value();
  std::vector<double> good, malfunctioned;
  for (const PaperTableRow& row : kPaperTable) {
    if (row.verdict() == Verdict::kGood) good.push_back(row.error_low);
    if (row.verdict() == Verdict::kMalfunctioned) malfunctioned.push_back(row.error_low);
  }
  const Trapezoid& set = learned.base.levels[0].inputs[0].sets[0].shape;
  EXPECT_NEAR(set.c, quantile(good, 0.75), 1e-12);
  EXPECT_NEAR(set.d, quantile(malfunctioned, 0.25), 1e-12);
  EXPECT_EQ(learned.wrong, 0u);
}

TEST(LearnRuleBase, RefusesAClassWithTwoValvesAndTakesThree) {
  auto valves = draw({}, 1);
  keep_only(valves, Verdict::kSevere, 3);
  EXPECT_TRUE(learn_rule_base(valves, {}));
  keep_only(valves, Verdict::kSevere, 2);
  const auto refused = learn_rule_base(valves, {});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "too_few_labels");
  EXPECT_NE(refused.error().message.find("2 Severe"), std::string::npos);
}

TEST(LearnRuleBase, RefusesLabelsOfOneClassOrWithoutGoodValves) {
  auto valves = draw({}, 1);
  keep_only(valves, Verdict::kGood, 0);
  EXPECT_EQ(learn_rule_base(valves, {}).error().code, "too_few_labels");
  valves = draw({}, 1);
  keep_only(valves, Verdict::kMalfunctioned, 0);
  keep_only(valves, Verdict::kSevere, 0);
  EXPECT_EQ(learn_rule_base(valves, {}).error().code, "too_few_labels");
  EXPECT_EQ(learn_rule_base({}, {}).error().code, "too_few_labels");
}

TEST(LearnRuleBase, IsATwoClassBaseWhereOneClassIsNotLabelled) {
  for (const Verdict absent : {Verdict::kMalfunctioned, Verdict::kSevere}) {
    auto valves = draw({}, 1);
    keep_only(valves, absent, 0);
    const auto learned = learn_rule_base(valves, {}).value();
    EXPECT_EQ(learned.wrong, 0u);
    EXPECT_TRUE(validate(learned.base));
    EXPECT_TRUE(check_rule_base(learned.base).empty());
    ASSERT_EQ(learned.notes.size(), 1u);
    EXPECT_NE(learned.notes[0].find(to_string(absent)), std::string::npos);
  }
}

TEST(LearnRuleBase, LeavesOutALevelWithTooFewValvesAndSaysSo) {
  auto valves = draw({}, 1);
  valves[0].levels.push_back({.level_a = 1.8, .error_eq20 = 1});
  const auto learned = learn_rule_base(valves, {}).value();
  EXPECT_EQ(learned.base.levels.size(), 2u);
  ASSERT_EQ(learned.notes.size(), 1u);
  EXPECT_NE(learned.notes[0].find("1.8"), std::string::npos);
}

TEST(LearnRuleBase, AFaultThatShowsAtOneLevelOnlyDoesNotSpoilTheOthers) {
  auto valves = draw({.per_class = 20}, 3);
  // At 1.6 A the malfunctioned valves look exactly like good ones.
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (LabelledValve& valve : valves) {
    if (valve.verdict == Verdict::kMalfunctioned) valve.levels[1].error_eq20 = 1 + 0.1 * normal(random);
  }
  const auto learned = learn_rule_base(valves, {}).value();
  EXPECT_EQ(learned.wrong, 0u);
}

TEST(LearnRuleBase, UsesRiseTimeWhereItSeparatesAndStillClassifiesWithoutIt) {
  auto valves = draw({}, 1);
  add_rise_times(valves);
  const auto learned = learn_rule_base(valves, {}).value();
  ASSERT_EQ(learned.base.levels[0].inputs.size(), 2u);
  EXPECT_EQ(learned.base.levels[0].rules.size(), 12u);  // 3 on the error alone, 9 on both
  EXPECT_EQ(learned.wrong, 0u);

  const auto full = classify(learned.base, valves[0].levels).value();
  EXPECT_EQ(full.per_level[0].rules.size(), 9u);
  EXPECT_TRUE(full.per_level[0].inputs_missing.empty());
  for (LevelFeatures& level : valves[0].levels) level.rise_time_s.reset();
  const auto partial = classify(learned.base, valves[0].levels).value();
  EXPECT_EQ(partial.verdict, Verdict::kGood);
  EXPECT_EQ(partial.per_level[0].rules.size(), 3u);
  EXPECT_EQ(partial.per_level[0].inputs_missing, std::vector{Quantity::kRiseTime});
}

TEST(LearnRuleBase, LeavesOutAnInputThatDoesNotSeparateAndSaysSo) {
  auto valves = draw({}, 1);
  for (LabelledValve& valve : valves) valve.levels[0].settling_error = 2.0;
  const auto learned = learn_rule_base(valves, {}).value();
  EXPECT_EQ(learned.base.levels[0].inputs.size(), 1u);
  ASSERT_EQ(learned.notes.size(), 1u);
  EXPECT_NE(learned.notes[0].find("settling_error"), std::string::npos);
}

TEST(LearnRuleBase, TakesTheMagnitudeOfASettlingError) {
  const LevelFeatures below{.level_a = 1.4, .error_eq20 = 1, .settling_error = -3.0};
  EXPECT_EQ(value_of(below, Quantity::kSettlingError), 3.0);
}

TEST(LearnRuleBase, RefusesAFigureThatIsNotFinite) {
  auto valves = draw({}, 1);
  valves[3].levels[0].rise_time_s = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(learn_rule_base(valves, {}).error().code, "not_finite");
}

RC_GTEST_PROP(LearnRuleBase, IsSoundAndMonotoneForAnyPopulation, (unsigned seed)) {
  Population population;
  population.per_class = *rc::gen::inRange(3, 15);
  population.spread = *rc::gen::inRange(0, 300) / 100.0;  // up to wholly overlapping classes
  population.levels.resize(std::size_t(*rc::gen::inRange(1, 3)));
  auto valves = draw(population, seed);
  if (*rc::gen::arbitrary<bool>()) add_rise_times(valves);
  const auto learned = learn_rule_base(valves, {});
  RC_ASSERT(learned.has_value());
  RC_ASSERT(validate(learned->base).has_value());
  const auto findings = check_rule_base(learned->base);
  RC_ASSERT(std::none_of(findings.begin(), findings.end(), [](const auto& f) { return f.is_fault(); }));
}

}  // namespace
}  // namespace valvetriage
