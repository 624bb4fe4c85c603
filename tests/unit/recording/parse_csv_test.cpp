#include "core/recording/parse_csv.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <ostream>

#include "core/recording/limits.h"
#include "tests/unit/recording/csv_text.h"

namespace valvetriage {
namespace {

TEST(ParseCsv, ReadsTheContractsExample) {
  const auto raw = parse_text("# serial: EFC-104233\n# test: step\n" + kHeader + good_rows(40));
  ASSERT_TRUE(raw) << raw.error().message;
  EXPECT_EQ(*raw->metadata.serial, "EFC-104233");
  EXPECT_EQ(raw->time.values.size(), 40u);
  EXPECT_EQ(raw->input.values[19], 1.0);
  EXPECT_EQ(raw->input.values[20], 1.2);
  EXPECT_EQ(raw->input.unit, "A");
  EXPECT_EQ(raw->output.unit, "psi");
  EXPECT_EQ(raw->name, "valve.csv");
}

TEST(ParseCsv, ConvertsEveryAcceptedUnit) {
  const auto raw = [](const std::string& output) {
    std::string text = "time_ms,current_mA,pressure_" + output + "\n";
    for (int i = 0; i < 40; ++i) text += fmt::format("{},{},{}\n", 5 * i, 1000 + i, 100 + i);
    return *parse_text(text);
  };
  // 1 psi = 6894.757293168 Pa; the tolerance is that of the constants' printed digits
  EXPECT_NEAR(raw("bar").output.values[0], 1450.3773773, 1e-6);
  EXPECT_NEAR(raw("kPa").output.values[0], 14.503773773, 1e-8);
  EXPECT_NEAR(raw("MPa").output.values[0], 14503.773773, 1e-5);
  EXPECT_DOUBLE_EQ(raw("psi").output.values[1], 101);
  EXPECT_DOUBLE_EQ(raw("psi").time.values[1], 0.005);
  EXPECT_DOUBLE_EQ(raw("psi").input.values[1], 1.001);
  EXPECT_EQ(raw("bar").output.file_unit, "bar");
}

TEST(ParseCsv, MapsColumnsOfOtherMachinesAndSideInputs) {
  std::string text = "t_s;u;note;y;temperature_C;supply_bar\n";
  for (int i = 0; i < 40; ++i) text += fmt::format("{};{};it's \"fine\";{};20,5;1\n", i, i % 5, i % 7);
  const ColumnMapping mapping{.time = "t_s", .input = "u", .output = "y", .side = {"temperature_C", "supply_bar"}};
  const auto raw = parse_text(text, mapping);
  ASSERT_TRUE(raw) << raw.error().message;
  EXPECT_EQ(raw->input.unit, "");
  EXPECT_EQ(raw->time.unit, "s");
  ASSERT_EQ(raw->side.size(), 2u);
  EXPECT_EQ(raw->side[0].values[3], 20.5);
  EXPECT_EQ(raw->side[0].unit, "");
  EXPECT_EQ(raw->side[1].unit, "psi");
}

TEST(ParseCsv, TakesASamplingRateWhereThereIsNoTimeColumn) {
  std::string text = "u,y\n";
  for (int i = 0; i < 40; ++i) text += fmt::format("{},{}\n", i % 5, i);
  ColumnMapping mapping{.time = "", .input = "u", .output = "y", .side = {}};
  EXPECT_EQ(parse_text(text, mapping).error().code, "missing_column");
  mapping.sample_rate_hz = 100;
  EXPECT_TRUE(parse_text(text, mapping));
  mapping = {.time = "", .input = "", .output = "", .side = {}, .sample_rate_hz = 100};
  EXPECT_EQ(parse_text(kHeader + good_rows(40), mapping).error().code, "bad_columns");
  mapping.sample_rate_hz = -1;
  EXPECT_EQ(parse_text(kHeader + good_rows(40), mapping).error().code, "bad_sample_rate");
}

TEST(ParseCsv, SaysWhatIsNoTextAndWhere) {
  const std::string head = "time_s,current_A,pressure_psi\n";
  const auto message = [](const std::string& text) { return parse_text(text).error().message; };
  EXPECT_NE(message(head + "0,1,2\n0.1,1,\xFF\n").find("line 3, column 3"), std::string::npos);
  EXPECT_NE(message(head + "0,1,\xFF,,,,\n").find("save the file as UTF-8"), std::string::npos);
  EXPECT_NE(message(head + "0,1,2,3,4,\xFF\n").find("line 2, column 3"), std::string::npos);
  EXPECT_NE(message("# serial: S1\r# lot: L\rtime_s,current_A\r0,1\r").find("lines end in LF or CRLF"),
            std::string::npos);
  EXPECT_NE(message(head + "0,1," + std::string(1, '\0') + "\n").find("has a control character"), std::string::npos);
  EXPECT_NE(message(std::string("PK\x03\x04\x14\0\x06\0", 8)).find("save the sheet as CSV"), std::string::npos);
}

TEST(ParseCsv, ToleratesQuotesBlanksBlankLinesPlusSignsAndAMissingLastNewline) {
  std::string text = "\"time_s\" , \"current_A\",pressure_psi\r\n\r\n";
  for (int i = 0; i < 40; ++i) text += fmt::format(" {} ,\"+{}\",  {}e-1\r\n\n", i, i % 5, i);
  text += "40,1,\"4\"";
  const auto raw = parse_text(text);
  ASSERT_TRUE(raw) << raw.error().message;
  EXPECT_EQ(raw->output.values.size(), 41u);
  EXPECT_DOUBLE_EQ(raw->output.values[39], 3.9);
  EXPECT_EQ(raw->output.values[40], 4);
}

/// One bad line among good ones: what must be said about it.
struct BadLine {
  const char* line;
  const char* code;
  std::size_t column;
  const char* found;

  friend void PrintTo(const BadLine& bad, std::ostream* out) { *out << bad.code; }
};

class ParseCsvRefuses : public testing::TestWithParam<BadLine> {};

TEST_P(ParseCsvRefuses, WithLineColumnAndWhatWasFound) {
  const BadLine bad = GetParam();
  const auto raw = parse_text("# serial: 1\n" + kHeader + good_rows(40) + bad.line + "\n" + good_rows(40, 41));
  ASSERT_FALSE(raw);
  const Error& error = raw.error();
  EXPECT_EQ(error.code, bad.code);
  EXPECT_EQ(error.line, 43u);
  EXPECT_EQ(error.column, bad.column);
  EXPECT_EQ(error.found, bad.found);
  EXPECT_EQ(error.file, "valve.csv");
  EXPECT_FALSE(error.expected.empty());
  EXPECT_NE(error.message.find("line 43"), std::string::npos) << error.message;
}

INSTANTIATE_TEST_SUITE_P(
    Lines, ParseCsvRefuses,
    testing::Values(BadLine{"0.2,n/a,1", "not_a_number", 2, "n/a"}, BadLine{"0.2,1.0,", "not_a_number", 3, ""},
                    BadLine{"0.2,1.0.0,1", "not_a_number", 2, "1.0.0"},
                    BadLine{"0.2,0x10,1", "not_a_number", 2, "0x10"}, BadLine{"0.2,nan,1", "not_finite", 2, "nan"},
                    BadLine{"0.2,1,-inf", "not_finite", 3, "-inf"}, BadLine{"0.2,1,1e999", "not_finite", 3, "1e999"},
                    BadLine{"0.195,1,1", "time_not_increasing", 1, "0.195"},
                    BadLine{"-1,1,1", "time_not_increasing", 1, "-1"}, BadLine{"0.2,1", "ragged_row", 3, "2 fields"},
                    BadLine{"0.2,1,1,1", "ragged_row", 4, "4 fields"},
                    BadLine{"# note: late", "misplaced_metadata", 1, "# note: late"},
                    BadLine{"0.2,1,\xFF", "bad_text", 3, "0.2,1,\\xff"},
                    BadLine{"0.2,1,\"1", "not_a_number", 3, "\"1"}));

TEST(ParseCsv, RefusesANulByteInAColumnThatNobodyReads) {
  std::string text = "time_s,current_A,note,pressure_psi\n";
  for (int i = 0; i < 40; ++i) text += fmt::format("{},1,ok,1\n", i);
  EXPECT_TRUE(parse_text(text));
  EXPECT_EQ(parse_text(text + "40,1," + std::string(1, '\0') + ",1\n").error().code, "bad_text");
}

TEST(ParseCsv, RefusesTextWithoutSamplesAndTooFewOfThem) {
  for (const std::string& text : {std::string(), std::string("\n\n"), std::string("\xEF\xBB\xBF"), kHeader}) {
    EXPECT_EQ(parse_text(text).error().code, "no_samples") << text;
  }
  EXPECT_EQ(parse_text(kHeader + good_rows(kMinSamples - 1)).error().code, "too_few_samples");
  EXPECT_TRUE(parse_text(kHeader + good_rows(kMinSamples)));
}

TEST(ParseCsv, NamesTheColumnThatIsMissingDoubleOrOfAnUnknownUnit) {
  const auto error_of = [](const std::string& header) { return parse_text(header + "\n" + good_rows(40)).error(); };
  EXPECT_EQ(error_of("time_s,current_A,flow_lpm").code, "missing_column");
  EXPECT_EQ(error_of("time_s,current_A,flow_lpm").field, "output");
  EXPECT_EQ(error_of("time_s,current_A,pressure_psig").code, "unknown_unit");
  EXPECT_EQ(error_of("time_s,current_A,pressure_psig").column, 3u);
  EXPECT_EQ(error_of("time_s,current_A,pressure").code, "unknown_unit");
  EXPECT_EQ(error_of("time_s,time_ms,current_A,pressure_psi").code, "duplicate_column");
  EXPECT_EQ(error_of("time_s,current_A,current_A,pressure_psi").column, 3u);
}

TEST(ParseCsv, RefusesWhatIsAboveEachLimit) {
  const std::string longest(kMaxLineBytes - 3, 'x');  // with "# " and the line's end exactly the limit
  EXPECT_EQ(parse_text("# " + longest + "\n").error().code, "no_samples");
  EXPECT_EQ(parse_text("# x" + longest + "\n").error().code, "too_large");
  EXPECT_EQ(parse_text("# x" + longest + "\n").error().line, 1u);

  const auto columns = [](std::size_t count) {
    std::string header = "time_s,current_A,pressure_psi", row = "1,1,1";
    for (std::size_t i = 3; i < count; ++i) header += fmt::format(",c{}", i), row += ",0";
    return parse_text(header + "\n" + row + "\n").error().code;
  };
  EXPECT_EQ(columns(kMaxColumns), "too_few_samples");
  EXPECT_EQ(columns(kMaxColumns + 1), "too_large");
}

TEST(ParseCsv, RefusesMetadataThatContradictsItself) {
  const auto error = parse_text("# serial: 1\n# lot: 2\n# serial: 3\n" + kHeader + good_rows(40)).error();
  EXPECT_EQ(error.code, "duplicate_metadata");
  EXPECT_EQ(error.line, 3u);
  EXPECT_EQ(parse_text("# test: jump\n" + kHeader + good_rows(40)).error().code, "bad_metadata");
}

TEST(ParseCsv, TakesTheFirstDecimalMarkForTheWholeFile) {
  std::string text = "time_s;current_A;pressure_psi\n";
  for (int i = 0; i < 40; ++i) text += fmt::format("{};1;2\n", i);
  EXPECT_EQ(parse_text(text + "40;1,5;2\n")->input.values.back(), 1.5);
  EXPECT_EQ(parse_text(text + "40;1.5;2\n")->input.values.back(), 1.5);
  EXPECT_EQ(parse_text(text + "40;1,5;2.5\n").error().code, "not_a_number");
  EXPECT_EQ(parse_text(text + "40;1.5;2,5\n").error().code, "not_a_number");
  EXPECT_EQ(parse_text(text + "40;1.234,5;2\n").error().code, "not_a_number");
}

RC_GTEST_PROP(ParseCsv, ReadsEveryDecimalAsTheStandardLibraryDoes, ()) {
  std::string text = kHeader;
  std::vector<double> expected;
  for (int i = 0; i < 40; ++i) {
    const auto digits = static_cast<unsigned long long>(*rc::gen::arbitrary<std::uint64_t>());
    std::string number = std::to_string(digits >> *rc::gen::inRange(0, 64));
    const auto point = static_cast<std::size_t>(*rc::gen::inRange(0, 22));
    if (point < number.size()) number.insert(number.size() - point, ".");
    if (*rc::gen::arbitrary<bool>()) number.insert(0, "-");
    if (*rc::gen::inRange(0, 5) == 0) number += "e-3";
    double value = 0;
    RC_PRE(std::from_chars(number.data(), number.data() + number.size(), value).ec == std::errc{});
    expected.push_back(value);
    text += fmt::format("{},1,{}\n", i, number);
  }
  const auto raw = parse_text(text);
  RC_ASSERT(raw.has_value());
  RC_ASSERT(raw->output.values == expected);
}

struct Dialect {
  char separator;
  bool decimal_comma;
  const char* line_end;
  bool byte_order_mark;
  bool quoted;
  bool last_end;
};

std::string written(const std::vector<std::vector<double>>& columns, const Dialect& dialect) {
  std::string text = dialect.byte_order_mark ? "\xEF\xBB\xBF" : "";
  text += fmt::format("# serial: S-1{}time_s{}current_A{}pressure_psi{}", dialect.line_end, dialect.separator,
                      dialect.separator, dialect.line_end);
  for (std::size_t i = 0; i < columns[0].size(); ++i) {
    if (i > 0) text += dialect.line_end;
    for (std::size_t c = 0; c < columns.size(); ++c) {
      std::string number = fmt::format("{}", columns[c][i]);
      if (dialect.decimal_comma) std::ranges::replace(number, '.', ',');
      if (c > 0) text += dialect.separator;
      text += dialect.quoted ? '"' + number + '"' : number;
    }
  }
  return dialect.last_end ? text + dialect.line_end : text;
}

RC_GTEST_PROP(ParseCsv, ReadsBackEqualWhatAnyAcceptedDialectWrote, ()) {
  const auto rows = static_cast<std::size_t>(*rc::gen::inRange(32, 120));
  std::vector<std::vector<double>> columns(3);
  double time = 1e-3 * *rc::gen::arbitrary<int>();
  for (std::size_t i = 0; i < rows; ++i) {
    columns[0].push_back(time += 1e-3 * *rc::gen::inRange(1, 1000));
    for (std::size_t c : {1u, 2u}) {
      const double value = *rc::gen::arbitrary<double>();
      columns[c].push_back(std::isfinite(value) ? value : 0.5);
    }
  }
  Dialect dialect;
  dialect.separator = *rc::gen::element(',', ';', '\t');
  dialect.decimal_comma = dialect.separator != ',' && *rc::gen::arbitrary<bool>();
  dialect.line_end = *rc::gen::element("\n", "\r\n");
  dialect.byte_order_mark = *rc::gen::arbitrary<bool>();
  dialect.quoted = *rc::gen::arbitrary<bool>();
  dialect.last_end = *rc::gen::arbitrary<bool>();
  TextSource source(written(columns, dialect), static_cast<std::size_t>(*rc::gen::inRange(1, 5000)),
                    *rc::gen::arbitrary<bool>());
  const auto raw = parse_csv(source, "", {});
  RC_ASSERT(raw.has_value());
  RC_ASSERT(raw->time.values == columns[0]);
  RC_ASSERT(raw->input.values == columns[1]);
  RC_ASSERT(raw->output.values == columns[2]);
}

}  // namespace
}  // namespace valvetriage
