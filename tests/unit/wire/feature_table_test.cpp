#include "server/wire/feature_table.h"

#include <gtest/gtest.h>

namespace valvetriage {
namespace {

Error error_of(std::string_view text) {
  const auto table = parse_feature_table(text);
  EXPECT_FALSE(table) << text;
  return table ? Error{} : table.error();
}

void expect_error(std::string_view text, std::string_view code, std::size_t line, std::size_t column) {
  const Error error = error_of(text);
  EXPECT_EQ(error.code, code) << text;
  EXPECT_EQ(error.line, line) << text;
  EXPECT_EQ(error.column, column) << text;
}

TEST(FeatureTable, ReadsLevelsFurtherQuantitiesAndVerdicts) {
  const auto table = parse_feature_table(
                         "serial,error_low,error_1.8A,rise_time_low,settling_error_1.8,verdict\n"
                         "a,1.0,2.5,0.12,-3,Good\n"
                         "b,1.5,,0.2,,Severe\n")
                         .value();
  ASSERT_EQ(table.rows.size(), 2u);
  EXPECT_TRUE(table.has_verdicts);
  const FeatureRow& first = table.rows[0];
  EXPECT_EQ(first.line, 2u);
  EXPECT_EQ(first.serial, "a");
  EXPECT_EQ(first.verdict, Verdict::kGood);
  ASSERT_EQ(first.levels.size(), 2u);
  EXPECT_DOUBLE_EQ(first.levels[0].level_a, 1.4);
  EXPECT_DOUBLE_EQ(*first.levels[0].rise_time_s, 0.12);
  EXPECT_DOUBLE_EQ(first.levels[1].level_a, 1.8);
  EXPECT_DOUBLE_EQ(*first.levels[1].settling_error, -3);
  EXPECT_EQ(table.rows[1].levels.size(), 1u) << "an empty error is a level that was not measured";
}

TEST(FeatureTable, ReadsABandwidthInHertzAboveZero) {
  const auto table = parse_feature_table("error_low,bandwidth_low\n1,2.5\n1,\n").value();
  EXPECT_DOUBLE_EQ(*table.rows[0].levels[0].bandwidth_hz, 2.5);
  EXPECT_FALSE(table.rows[1].levels[0].bandwidth_hz);
  expect_error("error_low,bandwidth_low\n1,0\n", "not_positive", 2, 2);
  expect_error("error_low,bandwidth_low\n1,-2\n", "negative", 2, 2);
}

TEST(FeatureTable, TakesSemicolonTabDecimalCommaByteOrderMarkCommentsAndCrLf) {
  for (const char* text : {"\xEF\xBB\xBF"
                           "error_low;error_high\r\n1,25;0,9\r\n",
                           "# a note\nerror_low\terror_high\n\n1.25\t0,9\n"}) {
    const auto table = parse_feature_table(text);
    ASSERT_TRUE(table) << table.error().message;
    ASSERT_EQ(table->rows.size(), 1u);
    EXPECT_DOUBLE_EQ(table->rows[0].levels[0].error_eq20, 1.25);
    EXPECT_DOUBLE_EQ(table->rows[0].levels[1].error_eq20, 0.9);
  }
}

TEST(FeatureTable, EveryErrorHasItsLineAndColumn) {
  expect_error("error_low,error_high\n1,0.9\n1,x\n", "not_a_number", 3, 2);
  expect_error("# note\nerror_low,error_high\n1,inf\n", "not_finite", 3, 2);
  expect_error("error_low,error_high\n-1,1\n", "negative", 2, 1);
  expect_error("error_low,error_high\n1\n", "wrong_field_count", 2, 2);
  expect_error("error_low,error_high\n1,2,3\n", "wrong_field_count", 2, 3);
  expect_error("error_low,error_1.4\n1,2\n", "duplicate_column", 1, 2);
  expect_error("error_low,verdict\n1,Bad\n", "unknown_verdict", 2, 2);
  expect_error("serial,verdict\n1,Good\n", "missing_column", 1, 1);
  expect_error("error_low,rise_time_high\n1,0.1\n", "missing_column", 1, 1);
}

TEST(FeatureTable, SaysWhatStoodThereAndWhatWasExpected) {
  const Error error = error_of("error_low,error_high\n1,n/a\n");
  EXPECT_EQ(error.message, "line 2, column 2 (error_high): 'n/a' is not a number");
  EXPECT_EQ(error.found, "n/a");
  EXPECT_EQ(error.expected, "a number");
}

TEST(FeatureTable, NeedsARow) {
  EXPECT_EQ(error_of("").code, "no_rows");
  EXPECT_EQ(error_of("error_low,error_high\n").code, "no_rows");
}

TEST(FeatureTable, BoundsBytesRowsAndColumns) {
  EXPECT_EQ(error_of(std::string(kMaxTableBytes + 1, '\n')).code, "too_large");
  EXPECT_EQ(error_of(std::string(kMaxTableBytes, '\n')).code, "no_rows");

  std::string rows = "error_low\n";
  for (std::size_t i = 0; i < kMaxTableRows; ++i) rows += "1\n";
  EXPECT_TRUE(parse_feature_table(rows));
  rows += "1\n";
  EXPECT_EQ(error_of(rows).code, "too_large");

  std::string header = "error_low";
  std::string row = "1";
  for (std::size_t i = 1; i < kMaxTableColumns; ++i) {
    header += ",x";
    row += ",";
  }
  EXPECT_TRUE(parse_feature_table(header + "\n" + row + "\n"));
  EXPECT_EQ(error_of(header + ",x\n" + row + ",\n").code, "too_large");
}

TEST(LabelledValves, NeedTheVerdictColumn) {
  const auto table = parse_feature_table("error_low\n1\n").value();
  EXPECT_EQ(labelled_valves(table).error().code, "missing_column");
  const auto labelled = parse_feature_table("error_low,verdict\n1,severe\n").value();
  EXPECT_EQ(labelled_valves(labelled)->at(0).verdict, Verdict::kSevere);
}

}  // namespace
}  // namespace valvetriage
