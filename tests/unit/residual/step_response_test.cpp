#include "core/residual/step_response.h"

#include <gtest/gtest.h>

#include "tests/unit/residual/recordings.h"

namespace valvetriage {
namespace {

using test::lag;

TEST(StepResponse, OnlyRisingStepsAreFound) {
  Recording recording = test::step_recording(200, 1.0, 1.6, 1, 3, lag, 0, 1);
  recording.segments.push_back({.kind = SegmentKind::kStep, .begin = 500, .end = 600, .level = 1.0, .from_level = 1.6});
  const auto steps = rising_steps(recording, 4);
  ASSERT_EQ(steps.size(), 1u);
  EXPECT_EQ(steps[0].begin, 200u);
  EXPECT_EQ(steps[0].level, 1.6);
  EXPECT_EQ(steps[0].recording, 4u);
}

TEST(ErrorEq20, OfAConstantResidualIsItsSizeTimesRootOfRateOverDuration) {
  const Recording recording = test::step_recording(200, 1.0, 1.6, 1, 4, lag, 0, 1);
  std::vector<double> simulated = recording.output.values;
  for (double& y : simulated) y -= 0.5;
  const auto step = rising_steps(recording, 0).front();
  const auto error = error_eq20(recording, simulated, step, {.rate_hz = 200, .duration_s = 2});
  ASSERT_TRUE(error);
  EXPECT_NEAR(*error, 0.5 * std::sqrt(200.0 / 2.0), 1e-12);
}

TEST(ErrorEq20, AtALowerRateIsTakenFromEveryOtherSample) {
  Recording recording = test::step_recording(200, 1.0, 1.6, 1, 4, lag, 0, 1);
  std::vector<double> simulated = recording.output.values;
  for (std::size_t i = 0; i < simulated.size(); ++i) simulated[i] -= (i % 2 == 0) ? 1.0 : 7.0;
  const auto step = rising_steps(recording, 0).front();
  EXPECT_NEAR(*error_eq20(recording, simulated, step, {.rate_hz = 100, .duration_s = 2}), std::sqrt(200.0) / 2, 1e-9);
}

TEST(ErrorEq20, CountsOnlyTheWindow) {
  const Recording recording = test::step_recording(200, 1.0, 1.6, 1, 4, lag, 0, 1);
  std::vector<double> simulated = recording.output.values;
  for (std::size_t i = 0; i < 200; ++i) simulated[i] += 50;                 // before the step
  for (std::size_t i = 600; i < simulated.size(); ++i) simulated[i] += 50;  // after two seconds
  const auto step = rising_steps(recording, 0).front();
  EXPECT_EQ(*error_eq20(recording, simulated, step, {.rate_hz = 200, .duration_s = 2}), 0);
}

TEST(ErrorEq20, IsRefusedWhereTheHoldDoesNotCoverTheWindow) {
  const Recording recording = test::step_recording(200, 1.0, 1.6, 1, 3, lag, 0, 1);
  const auto step = rising_steps(recording, 0).front();
  EXPECT_TRUE(error_eq20(recording, recording.output.values, step, {.rate_hz = 200, .duration_s = 2.0}));
  EXPECT_FALSE(error_eq20(recording, recording.output.values, step, {.rate_hz = 200, .duration_s = 2.005}));
}

TEST(ErrorEq20, IsRefusedWhereTheRecordingIsSlowerThanTheWindow) {
  const Recording recording = test::step_recording(100, 1.0, 1.6, 1, 4, lag, 0, 1);
  const auto step = rising_steps(recording, 0).front();
  EXPECT_TRUE(error_eq20(recording, recording.output.values, step, {.rate_hz = 100, .duration_s = 2}));
  EXPECT_FALSE(error_eq20(recording, recording.output.values, step, {.rate_hz = 101, .duration_s = 2}));
}

TEST(ErrorEq20, IsRefusedWhereAGapLiesInTheWindow) {
  Recording recording = test::step_recording(200, 1.0, 1.6, 1, 4, lag, 0, 1);
  recording.valid.assign(recording.samples(), 1);
  recording.valid[599] = 0;
  const auto step = rising_steps(recording, 0).front();
  EXPECT_FALSE(error_eq20(recording, recording.output.values, step, {.rate_hz = 200, .duration_s = 2}));
  recording.valid[599] = 1;
  recording.valid[600] = 0;
  EXPECT_TRUE(error_eq20(recording, recording.output.values, step, {.rate_hz = 200, .duration_s = 2}));
}

TEST(SettlingError, IsTheDistanceAtTheEndOfTheWindow) {
  const Recording recording = test::step_recording(200, 1.0, 1.6, 1, 4, lag, 0, 1);
  std::vector<double> simulated = recording.output.values;
  for (std::size_t i = 400; i < simulated.size(); ++i) simulated[i] += 3;
  const auto step = rising_steps(recording, 0).front();
  EXPECT_NEAR(*settling_error(recording, simulated, step, {.rate_hz = 200, .duration_s = 2}), 3, 1e-9);
}

TEST(RiseTime, OfAFirstOrderLagIsItsTimeConstantTimesLogNine) {
  const Recording recording = test::step_recording(1000, 1.0, 1.6, 1, 4, lag, 0.2, 5);
  const auto step = rising_steps(recording, 0).front();
  const auto rise = measured_rise_time_s(recording, step, {.rate_hz = 200, .duration_s = 2}, 0.2);
  ASSERT_TRUE(rise);
  // 0.2 psi of noise (0.12 after a median of five) at the 90 % crossing, where the slope is 67 psi/s: 1.8 ms; four of
  // them allowed.
  EXPECT_NEAR(*rise, 0.15 * std::log(9.0), 0.0075);
}

TEST(RiseTime, IsNotGivenWhereNothingRises) {
  const Recording recording = test::step_recording(
      200, 1.0, 1.6, 1, 4, [](double) { return 3.0; }, 0.35, 5);
  const auto step = rising_steps(recording, 0).front();
  EXPECT_FALSE(measured_rise_time_s(recording, step, {.rate_hz = 200, .duration_s = 2}, 0.35));
}

}  // namespace
}  // namespace valvetriage
