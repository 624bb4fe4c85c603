#include "server/wire/rule_base_json.h"

#include <gtest/gtest.h>

#include "core/classify/paper_table.h"
#include "tests/unit/wire/schema_check.h"

namespace valvetriage {
namespace {

Json calibrated_document() {
  return to_json(embedded_rule_base("calibrated").value());
}

Result<RuleBase> read(const Json& document) {
  return rule_base_from_json(dump_json(document));
}

TEST(RuleBaseJson, EmbeddedFilesFollowTheSchemaAndAreRead) {
  for (const char* name : {"paper", "calibrated"}) {
    const auto base = embedded_rule_base(name);
    ASSERT_TRUE(base) << base.error().message;
    EXPECT_EQ(base->name, name);
    EXPECT_FALSE(base->window) << "Table I has no rate, duration or unit";
    EXPECT_EQ(schema_violations("rule_base", dump_json(to_json(*base))), "");
    EXPECT_EQ(schema_violations("rule_base", text_of(schema_folder() / "rule-bases" / (std::string(name) + ".json"))),
              "");
  }
  EXPECT_EQ(embedded_rule_base("nobody").error().code, "unknown_rule_base");
}

TEST(RuleBaseJson, PaperHasThePointsOfEq22AndTheRangesOfEq23) {
  const RuleBase paper = embedded_rule_base("paper").value();
  ASSERT_EQ(paper.levels.size(), 2u);
  for (const LevelRules& level : paper.levels) {
    const auto& sets = level.inputs.at(0).sets;
    ASSERT_EQ(sets.size(), 4u);
    EXPECT_EQ(sets[0].shape, left_trapezoid(0.4, 0.8));
    EXPECT_EQ(sets[1].shape, triangle(0.5, 0.9, 1.2));
    EXPECT_EQ(sets[2].shape, triangle(1.1, 1.3, 1.6));
    EXPECT_EQ(sets[3].shape, right_trapezoid(1.5, 1.8));
    const PaperCrispRanges printed = level.name == "low" ? kPaperCrispLow : kPaperCrispHigh;
    EXPECT_EQ(level.crisp.malfunctioned_from, printed.malfunctioned_from);
    EXPECT_EQ(level.crisp.severe_from, printed.severe_from);
    // The rule that fills the missing table: each set concludes what Eq 23 says at its peak.
    for (const Rule& rule : level.rules) {
      const Trapezoid& set = sets[*rule.sets[0]].shape;
      const double peak = std::isfinite(set.b) ? set.b : set.c;
      const Verdict eq23 = peak < printed.malfunctioned_from ? Verdict::kGood
                           : peak < printed.severe_from      ? Verdict::kMalfunctioned
                                                             : Verdict::kSevere;
      EXPECT_EQ(rule.then, eq23);
    }
  }
}

TEST(RuleBaseJson, IsReadBackAsItWasWritten) {
  RuleBase base = embedded_rule_base("calibrated").value();
  base.window = FeatureWindow{200, 2, "psi"};
  base.sha256 = rule_base_sha256(base);
  const auto back = read(to_json(base)).value();
  EXPECT_EQ(back.levels, base.levels);
  EXPECT_EQ(back.window, base.window);
  EXPECT_EQ(back.sha256, base.sha256);
  EXPECT_EQ(back.description, base.description);
}

TEST(RuleBaseJson, HashDependsOnTheContentAndNotOnTheLayout) {
  const Json document = calibrated_document();
  const auto spaced = rule_base_from_json(dump_json(document, true)).value();
  EXPECT_EQ(spaced.sha256, read(document)->sha256);
  Json changed = document;
  changed["levels"][0]["crisp"]["severe_from"] = 0.76;
  EXPECT_NE(read(changed)->sha256, spaced.sha256);
}

TEST(RuleBaseJson, ErrorsPointAtThePartThatIsWrong) {
  Json document = calibrated_document();
  document["levels"][1]["rules"][0]["then"] = "Bad";
  EXPECT_EQ(read(document).error().field, "/levels/1/rules/0/then");
  document = calibrated_document();
  document["levels"][0]["rules"][0]["if"][0] = "nobody";
  EXPECT_EQ(read(document).error().field, "/levels/0/rules/0/if");
  document = calibrated_document();
  document["levels"][0]["inputs"][0]["sets"][1]["points"] = {2, 1, 3, 4};
  EXPECT_EQ(read(document).error().field, "/levels/0/inputs/0/sets/1");
  document = calibrated_document();
  document["rate_hz"] = 200;
  EXPECT_EQ(read(document).error().field, "/duration_s");
}

TEST(RuleBaseJson, RefusesARuleBaseThatIsNotSound) {
  Json document = calibrated_document();
  document["levels"][0]["rules"][2]["then"] = "Good";
  EXPECT_EQ(read(document).error().code, "rule_base_not_monotone");
  document = calibrated_document();
  document["levels"][0]["inputs"][0]["sets"][0]["points"] = {nullptr, nullptr, 0.1, 0.2};
  EXPECT_EQ(read(document).error().code, "rule_base_uncovered");
}

TEST(RuleBaseJson, BoundsTheText) {
  EXPECT_EQ(rule_base_from_json(std::string(kMaxRuleBaseBytes, ' ')).error().code, "malformed_json");
  EXPECT_EQ(rule_base_from_json(std::string(kMaxRuleBaseBytes + 1, ' ')).error().code, "too_large");
}

TEST(ClassificationJson, HasTheFieldsOfTheContract) {
  const LevelFeatures features[] = {{.level_a = 1.4, .error_eq20 = 1.0}, {.level_a = 1.6, .error_eq20 = 0.9}};
  const Json row = to_json(classify(embedded_rule_base("calibrated").value(), features).value());
  EXPECT_EQ(row.at("verdict"), "Good");
  EXPECT_EQ(row.at("memberships").at("severe"), 0.0);
  EXPECT_EQ(row.at("per_level").at("high").at("verdict"), "Good");
  EXPECT_EQ(row.at("per_level").at("low").at("rules").size(), 3u);
  EXPECT_FALSE(row.contains("reason"));
}

TEST(ClassificationJson, SaysThatALevelIsMissing) {
  const LevelFeatures features[] = {{.level_a = 1.4, .error_eq20 = 1.0}};
  const Json row = to_json(classify(embedded_rule_base("calibrated").value(), features).value());
  EXPECT_TRUE(row.at("verdict").is_null());
  EXPECT_EQ(row.at("reason"), "level_missing");
}

}  // namespace
}  // namespace valvetriage
