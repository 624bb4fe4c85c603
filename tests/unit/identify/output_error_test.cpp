#include "core/identify/output_error.h"

#include <gtest/gtest.h>

#include <limits>

#include "core/identify/arx.h"
#include "tests/unit/identify/plants.h"

namespace valvetriage {
namespace {

using namespace test;

constexpr double kPeriod = 1.0 / 200;

Recording noisy_valve(std::size_t n, double noise, std::uint32_t seed) {
  const auto u = random_levels(n, 60, seed);
  auto y = run(second_order_valve(), u);
  add_noise(y, noise, seed + 500);
  return recording_of({u.begin() + 40, u.end()}, {y.begin() + 40, y.end()}, kPeriod);  // begins in motion
}

TEST(OutputError, FindsThePlantExactlyWithoutNoise) {
  const auto recording = noisy_valve(1500, 0, 1);
  const Recording* const all[] = {&recording};
  const auto fit = fit_output_error(all, {.order = 2, .zeros = 1, .delay_samples = 1}, {});
  ASSERT_TRUE(fit.has_value());
  EXPECT_LT(fit->run.rmse, 1e-4);  // of 94 psi steps: what the tolerance of the iteration leaves
  EXPECT_NEAR(fit->static_gain, 470, 1e-3);
  EXPECT_NEAR(fit->coefficients.a[1], second_order_valve().a[1], 1e-6);
}

// White noise on the output: ARX assumes white noise on the equation instead.
TEST(OutputError, IsConsistentWhereArxIsBiased) {
  const auto recording = noisy_valve(4000, 3.5, 2);
  const Recording* const all[] = {&recording};
  const OutputErrorStructure structure{.order = 2, .zeros = 1, .delay_samples = 1};
  const double truth = second_order_valve().a[1];
  const auto arx = fit_arx(all, structure).value();
  const auto oe = fit_output_error(all, structure, {}).value();
  EXPECT_GT(std::abs(arx.coefficients.a[1] - truth), 10 * arx.std_errors.a[1]);
  EXPECT_LT(std::abs(oe.coefficients.a[1] - truth), 4 * oe.std_errors.a[1]);
  EXPECT_NEAR(oe.run.rmse, 3.5, 0.15);  // the noise's own rms, known to 1 / √(2 · 4000) = 1.1 %
}

// 100 seeds: a coverage of 0.95 has a standard deviation of 0.022. White and strongly coloured noise.
TEST(OutputError, StandardErrorsCoverTheTruthUnderWhiteAndColouredNoise) {
  for (const double colour : {0.0, 0.9}) {
    int covered_pole = 0;
    int covered_gain = 0;
    constexpr int kSeeds = 100;
    for (std::uint32_t seed = 0; seed < kSeeds; ++seed) {
      auto recording = noisy_valve(1500, 0, 3000 + seed);
      Normal normal(seed);
      double noise = 0;
      for (auto& value : recording.output.values) value += noise = colour * noise + 0.35 * normal();
      const Recording* const all[] = {&recording};
      const auto fit = fit_output_error(all, {.order = 2, .zeros = 1, .delay_samples = 1}, {}).value();
      covered_pole += std::abs(fit.coefficients.a[2] - second_order_valve().a[2]) < 1.96 * fit.std_errors.a[2];
      covered_gain += std::abs(fit.static_gain - 470) < 1.96 * fit.std_errors.static_gain;
    }
    EXPECT_NEAR(covered_pole / double{kSeeds}, 0.95, 0.07) << colour;
    EXPECT_NEAR(covered_gain / double{kSeeds}, 0.95, 0.07) << colour;
  }
}

TEST(OutputError, RecordingsShareDynamicsButNotStatesAndOffsetsAndGapsTakeNoPart) {
  std::vector<Recording> recordings;
  for (std::uint32_t i = 0; i < 3; ++i) {
    recordings.push_back(noisy_valve(800, 0.35, 20 + i));
    for (auto& value : recordings.back().output.values) value += 10.0 * i;
  }
  recordings[2].valid.assign(recordings[2].samples(), 1);
  for (std::size_t t = 300; t < 350; ++t) {
    recordings[2].valid[t] = 0;
    recordings[2].output.values[t] = std::numeric_limits<double>::quiet_NaN();
  }
  const std::vector<const Recording*> all{&recordings[0], &recordings[1], &recordings[2]};
  const auto fit = fit_output_error(all, {.order = 2, .zeros = 1, .delay_samples = 1}, {}).value();
  EXPECT_NEAR(fit.run.rmse, 0.35, 0.03);
  EXPECT_NEAR(fit.run.output_offsets[1] - fit.run.output_offsets[0], 10, 0.1);
  EXPECT_NEAR(fit.run.output_offsets[2] - fit.run.output_offsets[0], 20, 0.1);

  OutputErrorOptions shared;
  shared.offsets = OffsetSharing::kShared;
  const auto together = fit_output_error(all, {.order = 2, .zeros = 1, .delay_samples = 1}, shared).value();
  EXPECT_EQ(together.run.output_offsets[0], together.run.output_offsets[2]);
  EXPECT_GT(together.run.rmse, 3);  // one constant cannot be 0, 10 and 20
}

TEST(OutputError, ItsFreeRunIsTheDifferenceEquationOfItsCoefficients) {
  auto recording = noisy_valve(600, 0.35, 40);
  const Recording* const all[] = {&recording};
  const auto fit = fit_output_error(all, {.order = 3, .zeros = 2, .delay_samples = 1}, {}).value();
  const auto again = free_run(all, fit.coefficients).value();
  for (std::size_t t = 0; t < recording.samples(); ++t)
    EXPECT_NEAR(again.simulated[0][t], fit.run.simulated[0][t], 1e-3);
  const auto& y = fit.run.simulated[0];
  const auto& u = recording.input.values;
  const auto& c = fit.coefficients;
  for (std::size_t t = 10; t < recording.samples(); ++t) {
    double next = 0;
    for (std::size_t i = 0; i < 3; ++i) next += c.b[i] * (u[t - 1 - i] - fit.run.input_offset);
    for (std::size_t j = 1; j < 4; ++j) next -= c.a[j] * (y[t - j] - fit.run.output_offsets[0]);
    EXPECT_NEAR(next + fit.run.output_offsets[0], y[t], 1e-6);
  }
}

TEST(OutputError, SurvivesASlowModeLongerThanTheRecord) {
  // Time constant 2000 samples in a record of 1000: penalised, not banned.
  const Plant slow{.b = {0.05}, .a = {1, -0.9995}, .delay = 1};
  const auto u = random_levels(1000, 20, 50);
  auto y = run(slow, u);
  add_noise(y, 0.01, 51);
  const auto recording = recording_of(u, y, kPeriod);
  const Recording* const all[] = {&recording};
  const auto fit = fit_output_error(all, {.order = 1, .zeros = 0, .delay_samples = 1}, {}).value();
  EXPECT_NEAR(fit.transfer_function.poles[0].real(), 0.9995, 0.0002);
}

TEST(OutputError, NeverRingsLongerThanAThirdOfTheRecord) {
  // White noise: whatever the fit makes of it must not be an undamped mode.
  Normal normal(60);
  std::vector<double> u(900), y(900);
  for (std::size_t t = 0; t < u.size(); ++t) u[t] = normal(), y[t] = normal();
  const auto recording = recording_of(u, y, kPeriod);
  const Recording* const all[] = {&recording};
  for (int order = 2; order <= 6; ++order) {
    const auto fit = fit_output_error(all, {.order = order, .zeros = order, .delay_samples = 0}, {}).value();
    for (const auto& pole : fit.transfer_function.poles) {
      EXPECT_LT(std::abs(pole), 1);
      if (pole.imag() == 0) continue;
      EXPECT_LT(-1 / std::log(std::abs(pole)), 900.0 / 3 * 1.001);
    }
  }
}

TEST(OutputError, GivesTheSameBitsEveryTime) {
  const auto recording = noisy_valve(1000, 0.35, 70);
  const Recording* const all[] = {&recording};
  const auto once = fit_output_error(all, {.order = 3, .zeros = 2, .delay_samples = 1}, {}).value();
  const auto twice = fit_output_error(all, {.order = 3, .zeros = 2, .delay_samples = 1}, {}).value();
  EXPECT_EQ(once.coefficients.a, twice.coefficients.a);
  EXPECT_EQ(once.coefficients.b, twice.coefficients.b);
  EXPECT_EQ(once.run.simulated, twice.run.simulated);
}

TEST(OutputError, RefusesShortConstantAndInfiniteDataByName) {
  const OutputErrorStructure structure{.order = 2, .zeros = 1, .delay_samples = 1};
  // 2 a, 2 b, 2 initial states, 1 offset: 70 samples are needed.
  auto recording = noisy_valve(40 + 69, 0.35, 80);
  const Recording* const all[] = {&recording};
  EXPECT_EQ(fit_output_error(all, structure, {}).error().code, "too_few_samples");
  recording = noisy_valve(40 + 70, 0.35, 80);
  EXPECT_TRUE(fit_output_error(all, structure, {}).has_value());
  recording.output.values[5] = std::numeric_limits<double>::infinity();
  EXPECT_EQ(fit_output_error(all, structure, {}).error().code, "not_finite");
  recording = noisy_valve(500, 0.35, 80);
  std::fill(recording.input.values.begin(), recording.input.values.end(), 1.2);
  EXPECT_EQ(fit_output_error(all, structure, {}).error().code, "constant_input");
  recording.valid.assign(recording.samples(), 0);
  EXPECT_EQ(fit_output_error(all, structure, {}).error().code, "no_samples");
}

TEST(FreeRun, RefusesAnUnstableModel) {
  const auto recording = noisy_valve(500, 0.35, 90);
  const Recording* const all[] = {&recording};
  const RationalCoefficients unstable{.domain = Domain::kZ, .sample_time_s = kPeriod, .b = {1}, .a = {1, -1.01}};
  EXPECT_EQ(free_run(all, unstable).error().code, "unstable");
}

}  // namespace
}  // namespace valvetriage
