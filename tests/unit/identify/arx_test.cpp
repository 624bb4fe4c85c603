#include "core/identify/arx.h"

#include <gtest/gtest.h>

#include "core/identify/output_error.h"
#include "core/identify/rls.h"
#include "tests/unit/identify/plants.h"

namespace valvetriage {
namespace {

using namespace test;

TEST(Arx, FindsThePlantExactlyWithoutNoiseThroughGapsAndOverRecordings) {
  const Plant plant = second_order_valve();
  std::vector<Recording> recordings;
  for (std::uint32_t seed = 1; seed <= 3; ++seed) {
    const auto u = random_levels(500, 10, seed);
    auto y = run(plant, u);
    for (auto& value : y) value += seed;  // each sensor zeroed anew
    recordings.push_back(recording_of(u, y, 0.005));
  }
  recordings[1].valid.assign(500, 1);
  for (std::size_t t = 200; t < 230; ++t) {
    recordings[1].valid[t] = 0;
    recordings[1].output.values[t] = 1e6;
  }
  const std::vector<const Recording*> all{&recordings[0], &recordings[1], &recordings[2]};
  const auto fit = fit_arx(all, {.order = 2, .zeros = 1, .delay_samples = 1});
  ASSERT_TRUE(fit.has_value());
  for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(fit->coefficients.a[i], plant.a[i], 1e-9);
  for (std::size_t i = 0; i < 2; ++i) EXPECT_NEAR(fit->coefficients.b[i], plant.b[i], 1e-7);
  EXPECT_NEAR(fit->static_gain, 470, 1e-5);
  EXPECT_TRUE(fit->full_rank);
}

TEST(Arx, EqualsTheAbsoluteRecursionThatForgetsNothing) {
  const auto u = random_levels(800, 10, 7);
  auto y = run(second_order_valve(), u);
  add_noise(y, 0.35, 8);
  const auto recording = recording_of(u, y, 0.005);
  const Recording* const all[] = {&recording};
  const auto fit = fit_arx(all, {.order = 2, .zeros = 1, .delay_samples = 1}).value();
  auto rls =
      RecursiveLeastSquares::create(
          {.form = RlsForm::kAbsolute, .order = 2, .input_terms = 2, .delay_samples = 1, .initial_covariance = 1e12})
          .value();
  for (std::size_t t = 0; t < u.size(); ++t) ASSERT_TRUE(rls.update(u[t], y[t]).has_value());
  // The prior of P(0) = 10¹² weighs 10⁻¹² against some 10³ squared regressors.
  EXPECT_NEAR(rls.theta_hat()[0], fit.coefficients.a[1], 1e-7);
  EXPECT_NEAR(rls.theta_hat()[3], fit.coefficients.b[1], 1e-5);
}

// Equation errors that are white: 200 seeds, so a coverage of 0.95 has a standard deviation of 0.015.
TEST(Arx, StandardErrorsCoverTheTruthUnderWhiteEquationErrors) {
  const Plant plant{.b = {2, 1}, .a = {1, -1.5, 0.7}, .delay = 1};
  int covered_a = 0;
  int covered_gain = 0;
  constexpr int kSeeds = 200;
  for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
    const auto u = random_levels(400, 5, 1000 + seed);
    Normal normal(seed);
    std::vector<double> y(u.size());
    for (std::size_t t = 3; t < u.size(); ++t) {
      y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + 2 * u[t - 1] + u[t - 2] + 0.1 * normal();
    }
    const auto recording = recording_of({u.begin() + 50, u.end()}, {y.begin() + 50, y.end()}, 0.01);
    const Recording* const all[] = {&recording};
    const auto fit = fit_arx(all, {.order = 2, .zeros = 1, .delay_samples = 1}).value();
    covered_a += std::abs(fit.coefficients.a[1] - plant.a[1]) < 1.96 * fit.std_errors.a[1];
    covered_gain += std::abs(fit.static_gain - 15) < 1.96 * fit.std_errors.static_gain;
  }
  EXPECT_NEAR(covered_a / double{kSeeds}, 0.95, 0.05);
  EXPECT_NEAR(covered_gain / double{kSeeds}, 0.95, 0.05);
}

TEST(Arx, RefusesWhatCannotBeIdentified) {
  const auto u = random_levels(100, 5, 1);
  auto recording = recording_of(u, run(second_order_valve(), u), 0.005);
  const Recording* const all[] = {&recording};
  EXPECT_EQ(fit_arx(all, {.order = 0}).error().code, "bad_option");
  EXPECT_EQ(fit_arx(all, {.order = 2, .zeros = 3}).error().code, "bad_option");
  EXPECT_EQ(fit_arx(all, {.order = 2, .zeros = 1, .delay_samples = 99}).error().code, "too_few_samples");
  EXPECT_EQ(fit_arx({}, {}).error().code, "no_samples");
  std::fill(recording.input.values.begin(), recording.input.values.end(), 1.2);
  EXPECT_EQ(fit_arx(all, {}).error().code, "constant_input");
}

TEST(Arx, TakesClocksThatJitterForOneRateAndTwoRatesForTwo) {
  const auto u = random_levels(100, 5, 1);
  const auto recording = recording_of(u, run(second_order_valve(), u), 0.005);
  auto other = recording;
  const Recording* const both[] = {&recording, &other};
  other.sample_period_s = 0.005 * 1.0009;
  EXPECT_TRUE(fit_arx(both, {}).has_value());
  other.sample_period_s = 0.005 * 1.0011;
  EXPECT_EQ(fit_arx(both, {}).error().code, "sample_time_differs");
}

}  // namespace
}  // namespace valvetriage
