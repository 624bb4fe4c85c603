#include "core/analysis/part_to_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "core/mechanisms/simulate_extended.h"
#include "core/recording/intersample.h"
#include "core/recording/segments.h"
#include "tests/unit/identify/valves.h"

namespace valvetriage {
namespace {

/// A current that steps from 1 to 2 A at sample `step`, and what follows it.
Recording step_at(std::size_t step, std::size_t samples, double rate_hz) {
  Recording recording{.name = "steps.csv", .sample_period_s = 1 / rate_hz};
  recording.input.unit = "A";
  recording.output.unit = "psi";
  for (std::size_t i = 0; i < samples; ++i) {
    recording.time_s.push_back(static_cast<double>(i) / rate_hz);
    recording.input.values.push_back(i < step ? 1 : 2);
    recording.output.values.push_back(static_cast<double>(i));
  }
  recording.segments = find_segments(recording.input.values, recording.sample_period_s);
  return recording;
}

TEST(PartToFit, ChangesNothingUpToTheLimitAndLeavesNoMoreThanThatAboveIt) {
  const std::vector<Recording> recordings{step_at(500, 1000, 2000), step_at(300, 1000, 2000)};
  const PartToFit whole = part_to_fit(recordings, 0, 2000);
  EXPECT_TRUE(whole.is_whole);
  EXPECT_EQ(whole.recordings[1].input.values, recordings[1].input.values);
  const PartToFit thinned = part_to_fit(recordings, 0, 1999);
  EXPECT_FALSE(thinned.is_whole);
  EXPECT_EQ(thinned.recordings[0].samples() + thinned.recordings[1].samples(), 1000u);
  EXPECT_DOUBLE_EQ(thinned.recordings[0].sample_period_s, 0.001);
  EXPECT_EQ(thinned.recordings[0].output.values[3], 6);
}

TEST(PartToFit, ThinsToTheRateOfTheReferenceAndNoFurther) {
  for (const auto& [rate_hz, stride] : {std::pair(100.0, 1u), {200.0, 1u}, {390.0, 1u}, {400.0, 2u}, {1000.0, 5u}}) {
    const Recording recording = step_at(500, 1000, rate_hz);
    EXPECT_EQ(part_to_fit(std::span(&recording, 1), 0.005).stride[0], stride) << rate_hz;
  }
}

TEST(PartToFit, KeepsTheInstantOfAStepBetweenTheSamplesThatItKeeps) {
  for (const std::size_t step : {500u, 501u, 502u, 503u, 504u}) {
    const Recording recording = step_at(step, 1000, 2000);
    const PartToFit part = part_to_fit(std::span(&recording, 1), 0, 250);
    ASSERT_EQ(part.stride[0], 4u);
    const IntervalSignal all = input_between_samples(recording), kept = input_between_samples(part.recordings[0]);
    double area = 0, area_kept = 0;
    for (std::size_t i = 480; i < 520; ++i) area += 0.5 * (all.start[i] + all.end[i]);
    for (std::size_t i = 120; i < 130; ++i) area_kept += 4 * 0.5 * (kept.start[i] + kept.end[i]);
    EXPECT_NEAR(area_kept, area, 1e-9) << step;
  }
}

TEST(PartToFit, IsTheFirstPartOfTheLongestWhereEveryFurtherSampleIsNeeded) {
  const std::vector<Recording> recordings{step_at(500, 1000, 200), step_at(50, 100, 200)};
  const PartToFit part = part_to_fit(recordings, 0, 700);
  EXPECT_FALSE(part.is_whole);
  EXPECT_EQ(part.stride[0], 1u);
  ASSERT_EQ(part.recordings[0].samples(), 600u);
  EXPECT_EQ(part.recordings[0].output.values.back(), 599);
  EXPECT_EQ(part.recordings[1].samples(), 100u);
}

TEST(PartToFit, GivesTheModelsFreeRunWhereARecordingWasCut) {
  const std::vector<Recording> recordings = test::session({}, 0, 1);
  const std::size_t samples = recordings[0].samples();
  const PartToFit part = part_to_fit(std::span(recordings).first(1), 0, samples - 100);
  const Model model = to_model(test::MadeValve{}.parameters, {.input = {0.5, 2.5}, .output = {0, 200}});
  const auto runs = on_all_samples(part, {part.recordings[0].output.values}, model, recordings);
  ASSERT_TRUE(runs);
  ASSERT_EQ(runs->front().size(), samples);
  const auto free = simulate_extended(model, recordings[0], InitialState{});
  EXPECT_EQ(runs->front()[samples - 101], recordings[0].output.values[samples - 101]);
  EXPECT_EQ(runs->front()[samples - 100], (*free)[samples - 100]);
}

TEST(PartToFit, GivesFreeRunsBackOnEverySample) {
  const test::MadeValve valve;
  const std::vector<Recording> recordings = test::session(valve, 0, 1);
  const std::size_t samples = recordings[0].samples();
  // Every second sample of a fast recording is a slow one's.
  Recording fast = recordings[0];
  fast.sample_period_s = 0.0025;
  const PartToFit part = part_to_fit(std::span(&fast, 1), 0, samples / 2);
  ASSERT_EQ(part.stride[0], 2u);
  const auto runs = on_all_samples(part, {part.recordings[0].output.values}, {}, std::span(&fast, 1));
  ASSERT_TRUE(runs);
  ASSERT_EQ(runs->front().size(), samples);
  EXPECT_EQ(runs->front()[100], fast.output.values[100]);
  EXPECT_DOUBLE_EQ(runs->front()[101], 0.5 * (fast.output.values[100] + fast.output.values[102]));
}

}  // namespace
}  // namespace valvetriage
