#include "core/identify/asymptotic_bode.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/analysis/paper_frequency.h"
#include "tests/unit/identify/responses.h"

namespace valvetriage {
namespace {

using test::plant_s;
using test::response_of;

std::vector<double> corners_hz(const std::vector<std::complex<double>>& roots) {
  std::vector<double> hz;
  for (const auto& r : roots) hz.push_back(-r.real() / (2 * std::numbers::pi));
  std::sort(hz.begin(), hz.end());
  return hz;
}

TEST(AsymptoticBode, FindsRealPolesAndZerosThatLieApart) {
  const auto truth = plant_s(470, {0.6, 12, 40}, {}, {4}, 0.005);
  const auto fit = fit_asymptotic(response_of(truth, 0.1, 100, 120, 0.01, 1), {.poles = 3, .zeros = 1}).value();
  const auto poles = corners_hz(fit.transfer_function.poles), zeros = corners_hz(fit.transfer_function.zeros);
  // 1 % of noise at 120 points: corners within a few percent.
  EXPECT_NEAR(poles[0], 0.6, 0.02);
  EXPECT_NEAR(poles[1], 12, 1);
  EXPECT_NEAR(poles[2], 40, 3);
  EXPECT_NEAR(zeros[0], 4, 0.2);
  EXPECT_NEAR(fit.static_gain, 470, 3);
  EXPECT_NEAR(fit.transfer_function.delay_s, 0.005, 0.0003);
}

TEST(AsymptoticBode, TheAsymptoteIsARoughAnswerThatTheCurveImproves) {
  const auto truth = plant_s(1, {0.5, 8, 30}, {}, {2}, 0);
  const auto fit = fit_asymptotic(response_of(truth, 0.05, 200, 150, 1e-6, 1), {.poles = 3, .zeros = 1}).value();
  EXPECT_GT(fit.j, 0);
  EXPECT_LT(fit.v, 1e-6 * fit.v_start);
  ASSERT_EQ(fit.asymptote.size(), 4u);
  // Poles and zeros four e-folds of a half apart: J's minimum lies in the region where V leads to the same order.
  const std::vector<double> types{fit.asymptote[0].t, fit.asymptote[1].t, fit.asymptote[2].t, fit.asymptote[3].t};
  EXPECT_EQ(types, (std::vector<double>{1, -1, 1, 1}));
}

TEST(AsymptoticBode, JIsAParabolaAwayFromTheBreakpoints) {
  // Eq 6 for one breakpoint moved where no measured point lies between: second differences are equal.
  const auto j = [](double x1) {
    double sum = 0;
    const Breakpoint b[] = {{x1, 1}};
    for (double x = 3; x < 6; x += 0.01) sum += 0.005 * std::pow(0.3 - asymptote_log_gain(b, x), 2);
    return sum;
  };
  const double first = j(2.0) - 2 * j(2.1) + j(2.2), second = j(2.3) - 2 * j(2.4) + j(2.5);
  EXPECT_NEAR(first / second, 1, 1e-9);
  EXPECT_GT(first, 0);
}

TEST(AsymptoticBode, ItsCurveAndAsymptoteAreThePapers) {
  for (const double t : {1.0, -1.0}) {
    const Breakpoint b[] = {{1.25, t}};
    for (double x = -5; x < 8; x += 0.37) {
      EXPECT_NEAR(log_gain(b, x), corner_log_gain(x, 1.25, t), 1e-12);
      EXPECT_NEAR(asymptote_log_gain(b, x), asymptote(x, 1.25, t), 1e-12);
    }
  }
}

TEST(AsymptoticBode, HasARealModelForAResonanceTooAndALargerMisfit) {
  const auto resonant = plant_s(1, {}, {{5, 0.1}});
  const auto fit = fit_asymptotic(response_of(resonant, 0.1, 100, 100, 0.001, 1), {.poles = 2, .zeros = 0}).value();
  for (const auto& p : fit.transfer_function.poles) EXPECT_EQ(p.imag(), 0);
  EXPECT_GT(std::sqrt(2 * fit.v / 100), 0.1);  // neper: 0.9 dB and more
}

TEST(AsymptoticBode, TellsTheSignOfTheGain) {
  const auto negative = plant_s(-0.4, {3}, {}, {}, 0.01);
  const auto fit = fit_asymptotic(response_of(negative, 0.1, 20, 60, 0.01, 1), {.poles = 1, .zeros = 0}).value();
  EXPECT_NEAR(fit.static_gain, -0.4, 0.01);
  EXPECT_NEAR(fit.transfer_function.delay_s, 0.01, 0.001);
}

TEST(AsymptoticBode, RefusesMoreThanThePointsHold) {
  const auto response = response_of(plant_s(1, {3}, {}), 0.1, 20, 8, 0.01, 1);
  EXPECT_EQ(fit_asymptotic(response, {.poles = 5, .zeros = 2}).error().code, "too_few_points");
  EXPECT_EQ(fit_asymptotic(response, {.poles = 1, .zeros = 2}).error().code, "bad_option");
}

}  // namespace
}  // namespace valvetriage
