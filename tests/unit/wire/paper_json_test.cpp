#include "server/wire/paper_json.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>

#include "server/wire/rule_base_json.h"

namespace valvetriage {
namespace {

const std::vector<PaperLine>& lines() {
  static const std::vector<PaperLine> checked =
      check_paper(embedded_rule_base("paper").value(), embedded_rule_base("calibrated").value());
  return checked;
}

// The value behind a line; NaN where there is none, which equals nothing.
double figure(std::string_view where, std::string_view name) {
  for (const PaperLine& line : lines()) {
    if (line.where != where) continue;
    for (const PaperFigure& f : line.figures) {
      if (f.name == name) return f.value;
    }
  }
  return std::numeric_limits<double>::quiet_NaN();
}

TEST(PaperCheck, FindsEveryHighErrorInTheSecondSet) {
  EXPECT_EQ(figure("Eqs 21, 22", "high_in_second_set"), 40);
}

TEST(PaperCheck, FindsTheLowErrorsInTheSecondAndThirdSet) {
  EXPECT_EQ(figure("Eqs 21, 22", "low_good_in_second_set"), 20);
  EXPECT_EQ(figure("Eqs 21, 22", "low_malfunctioned_in_third_set"), 10);
  EXPECT_EQ(figure("Eqs 21, 22", "low_severe_in_third_set"), 1);
  EXPECT_EQ(figure("Eqs 21, 22", "low_severe_error_in_third_set"), 1.5485);
}

TEST(PaperCheck, SeparatesTheHighColumnByTheStrengthOfTheSecondSet) {
  EXPECT_GT(figure("Eqs 21, 22", "second_set_good_smallest"), figure("Eqs 21, 22", "second_set_malfunctioned_largest"));
  EXPECT_GT(figure("Eqs 21, 22", "second_set_malfunctioned_smallest"),
            figure("Eqs 21, 22", "second_set_severe_largest"));
}

TEST(PaperCheck, FindsNoErrorInEightyUnderTheCrispRanges) {
  EXPECT_EQ(figure("Eq 23", "errors"), 80);
  EXPECT_EQ(figure("Eq 23", "wrong"), 0);
  EXPECT_EQ(figure("Eq 23", "largest_good_low"), 1.0634);
  EXPECT_EQ(figure("Eq 23", "largest_good_high"), 0.9229);
}

TEST(PaperCheck, FindsTypeConfoundedWithSeverity) {
  EXPECT_EQ(figure("Table I", "returned_type_1_severe"), 10);
  EXPECT_EQ(figure("Table I", "returned_type_2_malfunctioned"), 10);
}

TEST(PaperCheck, FindsThatGoodValvesErrAlikeAndByFourFifthsOfAMalfunctionedOne) {
  EXPECT_NEAR(figure("Table I, good valves", "good_spread_low_type_1"), 0.019, 0.0005);
  EXPECT_NEAR(figure("Table I, good valves", "good_spread_low_type_2"), 0.010, 0.0005);
  EXPECT_NEAR(figure("Table I, good valves", "good_over_malfunctioned_low"), 0.80, 0.005);
}

TEST(PaperCheck, FindsThePublishedAccuracyAndWhatBothRuleBasesGet) {
  EXPECT_DOUBLE_EQ(figure("Result", "published_accuracy"), 0.95);
  EXPECT_EQ(figure("Result", "paper_wrong"), 0);
  EXPECT_EQ(figure("Result", "calibrated_wrong"), 0);
  EXPECT_EQ(figure("Result", "calibrated_soft"), 0);
}

TEST(PaperCheck, SaysOfEveryLineWhatDoesNotHold) {
  std::set<std::string> places;
  for (const PaperLine& line : lines()) {
    EXPECT_TRUE(places.insert(line.where).second) << line.where;
    EXPECT_FALSE(line.as_printed.empty() || line.recomputed.empty() || line.does_not_hold.empty()) << line.where;
  }
  EXPECT_EQ(places.size(), 14u);
}

TEST(PaperJson, CarriesEveryLineWithItsFigures) {
  const Json document = to_json(lines());
  ASSERT_EQ(document["lines"].size(), lines().size());
  EXPECT_EQ(document["lines"][4]["where"], "Eq 18");
  EXPECT_EQ(document["lines"][4]["figures"][0]["name"], "pole_re");
}

}  // namespace
}  // namespace valvetriage
