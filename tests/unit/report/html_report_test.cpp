#include <gtest/gtest.h>

#include <cmath>

#include "server/report/lot_report.h"
#include "server/report/markup.h"
#include "server/report/valve_report.h"
#include "tests/unit/report/golden.h"

namespace valvetriage::report {
namespace {

constexpr const char* kHostile = "<img src=x onerror=\"alert('1')\">";
constexpr const char* kHostileEscaped = "&lt;img src=x onerror=&quot;alert(&#39;1&#39;)&quot;&gt;";

AnalysisDocument example(const std::string& name) {
  const auto document = parse_json(file_text(std::string(VALVETRIAGE_EXAMPLES_DIR) + "/" + name));
  EXPECT_TRUE(document);
  auto read = analysis_from_json(*document);
  EXPECT_TRUE(read) << read.error().message;
  return *read;
}

ValveReport sticking_valve() {
  ValveReport report{.subject = {.serial = "EFC-104233",
                                 .lot = "2026-W31-B",
                                 .valve_type = "type-1",
                                 .stand = "stand-3",
                                 .condition = "returned",
                                 .received_at = "2026-08-03T09:12:44Z"},
                     .analysis = example("analysis_named_cause.json"),
                     .plots = {}};
  Curve measured{.name = "measured", .ink = Ink::kMeasured, .x = {0, 1, 2}, .y = {1, 5, 4}};
  report.plots = {
      {.name = "steps.csv",
       .panels = {{.title = "Output [psi]", .height = 120, .curves = {measured}}},
       .stretches = {},
       .reason = {}},
      {.name = "sweep.mat", .panels = {}, .stretches = {}, .reason = "This recording cannot be drawn: MAT"}};
  return report;
}

/// Twelve valves, 0.8 ms later than thirty good ones; their frequency 10 % lower, which chance does as well.
LotShifts late_lot() {
  LotShifts shifts{.fitting = 12, .valves = 12, .valve_type = "type-1", .reference_version = 3, .good_valves = 30};
  shifts.figures = {{.figure = {.name = "delay_s", .unit = "s", .good = {.mean = 0.0064, .sd = 0.0005, .valves = 30}},
                     .shift = {.shift = 0.0008, .ci95 = {0.0004, 0.0012}, .p_value = 0.0004, .largest_single = 2.31},
                     .p_adjusted = 0.0008},
                    {.figure = {.name = "natural_frequency_rad_s",
                                .unit = "rad/s",
                                .logarithmic = true,
                                .good = {.mean = std::log(200), .sd = 0.1, .valves = 30}},
                     .shift = {.shift = std::log(0.9), .ci95 = {-0.3, 0.1}, .p_value = 0.3, .largest_single = 1},
                     .p_adjusted = 0.3}};
  return shifts;
}

LotReport small_lot() {
  LotReport report{
      .lot = "2026-W31-B", .first_received_at = "2026-08-03T09:12:44Z", .last_received_at = "2026-08-04T09:12:44Z"};
  report.shifts = late_lot();
  report.sizes = {.named = 1,
                  .read = 1,
                  .causes = {{.cause = "friction",
                              .valves = 2,
                              .parameters = {{.name = "breakaway_A",
                                              .unit = "A",
                                              .population_mean = 0.002,
                                              .population_sd = 0.001,
                                              .values = {{"sub_1", "EFC-2", 0.02, {0.018, 0.022}},
                                                         {"sub_2", "EFC-4", 0.03, {std::nan(""), std::nan("")}}}}}}}};
  report.patterns = {.unexplained = 50,
                     .compared = 40,
                     .groups = {{.members = {"EFC-7", "EFC-8"},
                                 .panels = {{.title = "Residual, step, 2.0 s",
                                             .height = 150,
                                             .curves = {{.name = "mean", .x = {0, 1, 2}, .y = {0, 5, 0}}}}}}},
                     .alone = {"EFC-9"}};
  report.valves = {{.serial = "EFC-1",
                    .received_at = "2026-08-03T09:12:44Z",
                    .verdict = "Good",
                    .conclusion = "none",
                    .error_eq20 = {{1.4, 3.2}},
                    .engine_version = "0.1.0",
                    .settings_sha256 = "aa",
                    .result_sha256 = "0123456789abcdef0123",
                    .inputs = {{"step_1.4A.csv", "5feceb66ffc86f38"}, {"sweep.csv", "6b86b273ff34fce1"}}},
                   {.serial = "EFC-2",
                    .received_at = "2026-08-03T10:00:00Z",
                    .verdict = "Severe",
                    .conclusion = "named",
                    .names = {{"friction", 0.97, 0.03}, {"sensor_offset", 0.955, 0.0375}},
                    .likely = "friction",
                    .likely_probability = 0.97,
                    .error_eq20 = {{1.4, 40}},
                    .engine_version = "0.1.0",
                    .settings_sha256 = "aa",
                    .result_sha256 = "fedcba9876543210"},
                   {.serial = "EFC-3",
                    .received_at = "2026-08-04T09:12:44Z",
                    .verdict = "Malfunctioned",
                    .conclusion = "ambiguous",
                    .likely = "backlash",
                    .likely_probability = 0.6,
                    .error_eq20 = {},
                    .engine_version = "0.1.0",
                    .settings_sha256 = "aa",
                    .result_sha256 = "77"}};
  report.levels = {{.level_a = 1.4,
                    .points = {{.value = 3.2, .verdict = "Good"}, {.value = 40, .verdict = "Severe"}},
                    .limits = ChartLimits{.centre = 21.6, .lower = 0, .upper = 119}}};
  return report;
}

TEST(ValveReport, IsTheGoldenFile) {
  expect_golden("valve.html", valve_report_html(sticking_valve()));
}

TEST(ValveReport, NamesEngineSettingsResultAndInputs) {
  const ValveReport report = sticking_valve();
  const std::string html = valve_report_html(report);
  for (const std::string& stated : {report.analysis.making.settings_sha256, report.analysis.result_sha256,
                                    report.analysis.analysis.recordings[0].sha256, std::string("valvetriage 0.1.0")}) {
    EXPECT_NE(html.find(stated), std::string::npos) << stated;
  }
}

TEST(ValveReport, NeedsNothingButItselfAndRunsNothing) {
  const std::string html = valve_report_html(sticking_valve());
  for (const char* forbidden : {"<script", "<link", "<img", "url(", "src=", "href=", "javascript:"}) {
    EXPECT_EQ(html.find(forbidden), std::string::npos) << forbidden;
  }
}

TEST(ValveReport, KeepsWhatAUserWroteAsText) {
  ValveReport report = sticking_valve();
  report.subject = {kHostile, kHostile, kHostile, kHostile, kHostile, kHostile};
  report.plots[0].name = report.plots[0].panels[0].curves[0].name = report.plots[0].panels[0].title = kHostile;
  report.plots[1].reason = kHostile;
  Analysis& analysis = report.analysis.analysis;
  analysis.recordings[0].name = kHostile;
  analysis.recordings[0].quality[0].detail = kHostile;
  analysis.baseline.reason = analysis.classification.rule_base_name = kHostile;
  analysis.discrepancy->causes[0].evidence = {kHostile};
  analysis.discrepancy->causes[0].parameters[0].second.text = kHostile;
  const std::string html = valve_report_html(report);
  EXPECT_EQ(html.find("<img"), std::string::npos);
  EXPECT_NE(html.find(kHostileEscaped), std::string::npos);
}

TEST(ValveReport, OfAnUnexplainedValveNamesNoFault) {
  ValveReport report = sticking_valve();
  report.analysis.analysis.discrepancy->conclusion = Conclusion::kUnexplained;
  report.analysis.analysis.discrepancy->causes.clear();
  const std::string html = valve_report_html(report);
  EXPECT_NE(html.find("It is not known what"), std::string::npos);
  EXPECT_EQ(html.find("fault"), std::string::npos);
}

TEST(LotShift, IsASentenceWithSizeUnitIntervalAndChance) {
  const auto sentences = shift_sentences(late_lot());
  ASSERT_EQ(sentences.size(), 1u) << "what chance does as well is no sentence";
  EXPECT_EQ(sentences[0],
            "Delay: +0.8 ms in all valves (95 %: +0.4 ms to +1.2 ms), 7.2 ms where good valves have 6.4 ms, p = 0.0008 "
            "paid for 2 figures. The farthest single valve is 2.3 standard deviations from good ones.");
}

TEST(LotShift, OfALogarithmicFigureIsInItsOwnUnit) {
  EXPECT_NEAR(late_lot().figures[1].difference(), -20, 1e-9);
  EXPECT_NEAR(late_lot().figures[1].lot_mean(), 180, 1e-9);
}

TEST(LotShift, TellsWhatWasComparedOrWhyNothingWas) {
  EXPECT_EQ(shift_scope({}),
            "No valve of this lot without a settled cause was compared with a stored reference of good valves.");
  LotShifts quiet = late_lot();
  quiet.figures[0].p_adjusted = 0.2;
  EXPECT_NE(shift_scope(quiet).find("No figure is shifted beyond chance."), std::string::npos);
  EXPECT_EQ(shift_scope(late_lot()).find("beyond chance"), std::string::npos);
}

TEST(LotReport, IsTheGoldenFile) {
  expect_golden("lot.html", lot_report_html(small_lot()));
}

TEST(LotReport, CountsAsCausesOnlyWhatIsSettled) {
  const std::string html = lot_report_html(small_lot());
  EXPECT_NE(html.find(">Friction</text>"), std::string::npos);
  EXPECT_NE(html.find(">Sensor offset</text>"), std::string::npos) << "a valve counts with each of its causes";
  EXPECT_NE(html.find("Friction, 97 % (q 0.03); Sensor offset, 96 % (q 0.037)"), std::string::npos) << html;
  EXPECT_EQ(html.find(">Backlash</text>"), std::string::npos);
  EXPECT_NE(html.find("not settled: Backlash, 60 %"), std::string::npos);
}

TEST(LotReport, ShowsTheSizesOfItsCausesAndThePatternsOfUnexplainedValves) {
  const std::string html = lot_report_html(small_lot());
  EXPECT_NE(html.find("2 valves: median 25 mA, the middle half from 22.5 mA to 27.5 mA"), std::string::npos);
  EXPECT_NE(html.find("The residuals over time of 40 of 50 valves that no cause explains were compared."),
            std::string::npos);
  EXPECT_NE(html.find("EFC-7, EFC-8"), std::string::npos);
  EXPECT_NE(html.find("Like no other: EFC-9."), std::string::npos);
}

TEST(LotReport, NamesTheInputsOfEachValveUnlessTheyWouldBeABook) {
  LotReport report = small_lot();
  const std::string html = lot_report_html(report);
  EXPECT_NE(html.find("<td>sweep.csv</td><td><code>6b86b273ff34fce1</code></td>"), std::string::npos);
  while (report.valves.size() <= 200) report.valves.push_back(report.valves.front());
  const std::string large = lot_report_html(report);
  EXPECT_EQ(large.find("6b86b273ff34fce1"), std::string::npos);
  EXPECT_NE(large.find("The hash of each input file stands in the report of its valve."), std::string::npos);
}

TEST(LotReport, KeepsWhatAUserWroteAsText) {
  LotReport report = small_lot();
  report.patterns.alone[0] = report.patterns.groups[0].members[0] = kHostile;
  report.lot = report.valves[0].serial = report.valves[1].names[0].cause = kHostile;
  report.valves[0].inputs[0].first = kHostile;
  EXPECT_EQ(lot_report_html(report).find("<img"), std::string::npos);
}

TEST(Escaped, LeavesNothingThatMarkupOrATerminalWouldRead) {
  EXPECT_EQ(escaped(kHostile), kHostileEscaped);
  EXPECT_EQ(escaped("a & b\x1b[1m\n"), "a &amp; b\xEF\xBF\xBD[1m\n");
  EXPECT_EQ(escaped("Prüfstand"), "Prüfstand");
}

}  // namespace
}  // namespace valvetriage::report
