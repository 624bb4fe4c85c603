#include "server/report/svg_plot.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>
#include <rapidcheck/gtest.h>

#include <cmath>
#include <limits>

#include "tests/unit/report/golden.h"

namespace valvetriage::report {
namespace {

constexpr double kGap = std::numeric_limits<double>::quiet_NaN();

std::vector<Panel> step_panels() {
  Curve measured{.name = "measured", .ink = Ink::kMeasured}, simulated{.name = "simulated", .ink = Ink::kSimulated};
  Curve extended{.name = "extended simulation", .ink = Ink::kExtended}, input{.name = "input", .ink = Ink::kInput};
  for (int i = 0; i < 20; ++i) {
    const double time_s = 0.1 * i;
    for (Curve* curve : {&measured, &simulated, &extended, &input}) curve->x.push_back(time_s);
    const double rise = i < 5 ? 0 : 1 - std::pow(0.7, i - 5);
    measured.y.push_back(i == 12 ? kGap : 100 * rise + (i % 2 ? 1 : -1));
    simulated.y.push_back(105 * rise);
    extended.y.push_back(100 * rise);
    input.y.push_back(i < 5 ? 1.0 : 1.6);
  }
  return {{.title = "Output [psi]", .height = 200, .curves = {measured, simulated, extended}},
          {.title = "Input [A]", .height = 90, .curves = {input}}};
}

TEST(TimePlot, IsTheGoldenFile) {
  expect_golden("time_plot.svg", time_plot("steps.csv <b>", step_panels()));
}

TEST(TimePlot, WithStretchesIsTheGoldenFile) {
  const std::vector<Stretch> stretches{{.from = 0, .to = 0.5, .name = "1.00 A"},
                                       {.from = 0.5, .to = 1.9, .name = "1.60 A"},
                                       {.from = 1.2, .to = 1.3, .name = "gap <b>", .odd = true}};
  expect_golden("time_plot_stretches.svg", time_plot("steps.csv", step_panels(), stretches));
}

TEST(TimePlot, NamesAStretchOnlyWhereThereIsRoom) {
  const std::vector<Stretch> stretches{{.from = 0, .to = 0.01, .name = "1.00 A"}};
  const std::string svg = time_plot("steps.csv", step_panels(), stretches);
  EXPECT_EQ(svg.find("1.00 A"), std::string::npos);
}

TEST(TimePlot, OfNothingIsStillADrawing) {
  const std::string svg = time_plot("empty", std::vector<Panel>{{.title = "Output", .height = 100, .curves = {{}}}});
  EXPECT_TRUE(svg.starts_with("<svg ")) << svg;
  EXPECT_EQ(svg.find("nan"), std::string::npos);
  EXPECT_EQ(svg.find("inf"), std::string::npos);
}

TEST(TimePlot, BreaksTheLineWhereNothingWasMeasured) {
  const Curve curve{.name = "y", .ink = Ink::kMeasured, .x = {0, 1, 2, 3, 4}, .y = {1, 2, kGap, 2, 1}};
  const std::string svg = time_plot("", std::vector<Panel>{{.title = "y", .height = 100, .curves = {curve}}});
  const auto path = svg.substr(svg.find(" d=\""));
  EXPECT_EQ(std::count(path.begin(), path.end(), 'M'), 2) << path;
}

TEST(BarPlot, IsTheGoldenFile) {
  const std::vector<Bar> bars{{.name = "simulation", .value = 2.4, .text = "2.4 psi"},
                              {.name = "with the causes", .value = 0.4, .text = "0.4 psi", .ink = Ink::kExtended},
                              {.name = "noise & more", .value = 0, .text = "0 psi", .ink = Ink::kInput}};
  expect_golden("bar_plot.svg", bar_plot("Error before and after", bars));
}

TEST(IndividualsPlot, IsTheGoldenFile) {
  const std::vector<ChartPoint> points{{.value = 12, .verdict = "Good"},
                                       {.value = 14, .verdict = "Malfunctioned"},
                                       {.value = 60, .verdict = "Severe", .outside = true},
                                       {.value = 13, .verdict = ""}};
  expect_golden("individuals_plot.svg",
                individuals_plot("Error (Eq 20) at 1.4 A", points, ChartLimits{.centre = 24, .lower = 2, .upper = 50}));
}

RC_GTEST_PROP(RoundTicks, LieInsideAndAreAboutAsManyAsWanted, ()) {
  const double low = *rc::gen::inRange(-100000, 100000) / 100.0;
  const double span = *rc::gen::inRange(1, 1000000) / 100.0;
  const int wanted = *rc::gen::inRange(2, 12);
  const auto ticks = round_ticks(low, low + span, wanted);
  RC_ASSERT(ticks.size() <= static_cast<std::size_t>(wanted) + 1);
  RC_ASSERT(!ticks.empty() || wanted < 4);  // a step of 1, 2, 5, 10 may leave a factor of 2.5 between
  for (const double tick : ticks) RC_ASSERT(tick >= low - 1e-6 * span && tick <= low + span * (1 + 1e-6));
}

TEST(RoundTicks, OfNothingAreNone) {
  EXPECT_TRUE(round_ticks(1, 1, 5).empty());
  EXPECT_EQ(round_ticks(0, 1, 5), (std::vector<double>{0, 0.2, 0.4, 0.6000000000000001, 0.8, 1}));
}

}  // namespace
}  // namespace valvetriage::report
