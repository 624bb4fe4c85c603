#include "core/analysis/part_to_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <utility>

#include "core/analysis/folded_tones.h"
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

TEST(PartToFit, PutsSideChannelsInTheSamePlacesAndAnEmptyOneWhereThereIsNone) {
  std::vector<Recording> recordings{step_at(50, 100, 200), step_at(30, 100, 200), step_at(30, 100, 200)};
  const Channel warm{.name = "temperature_C", .values = std::vector<double>(100, 40)};
  const Channel supply{.name = "supply_psi", .values = std::vector<double>(100, 450)};
  recordings[0].side = {warm, supply};
  recordings[1].side = {supply, warm};
  const PartToFit part = part_to_fit(recordings, 0);
  for (const Recording& recording : part.recordings) {
    ASSERT_EQ(recording.side.size(), 2u);
    EXPECT_EQ(recording.side[0].name, "temperature_C");
    EXPECT_EQ(recording.side[1].name, "supply_psi");
  }
  EXPECT_EQ(part.recordings[1].side[1].values, supply.values);
  EXPECT_TRUE(part.recordings[2].side[0].values.empty());
}

TEST(FoldedTones, AreGivenTheFrequencyOfTheWholeRecording) {
  // 120 and 280 Hz at 1 kHz look like 80 Hz at 200 Hz, as 80 Hz does.
  for (const double true_hz : {120.0, 280.0, 80.0}) {
    std::vector<Recording> recordings{step_at(500, 5000, 1000)};
    FreeRunsOf without{recordings[0].output.values};
    for (std::size_t i = 0; i < 5000; ++i) {
      recordings[0].output.values[i] += std::sin(2 * std::numbers::pi * true_hz * 0.001 * static_cast<double>(i) + 0.4);
    }
    const PartToFit part = part_to_fit(recordings, 0.005);
    std::vector<NamedCause> causes(1);
    causes[0].cause = "periodic_disturbance";
    causes[0].parameters = {{"frequency_hz", {.value = 80, .ci95 = {79.9, 80.2}, .unit = "Hz"}}};
    Model model;
    model.mechanisms = {{.cause = "periodic_disturbance", .parameters = {80, 1, 2}}};
    FreeRunsOf extended = without;
    unfold_tones(recordings, part, {&without, 1}, causes, model, extended);
    const ParameterEstimate& found = causes[0].parameters[0].second;
    EXPECT_DOUBLE_EQ(found.value, true_hz);
    const bool is_mirrored = true_hz == 120;
    EXPECT_NEAR(found.ci95[0], true_hz - (is_mirrored ? 0.2 : 0.1), 1e-9);
    EXPECT_NEAR(found.ci95[1], true_hz + (is_mirrored ? 0.1 : 0.2), 1e-9);
    EXPECT_DOUBLE_EQ(model.mechanisms[0].parameters[0], true_hz);
    if (true_hz == 80) continue;
    EXPECT_NEAR(model.mechanisms[0].parameters[2], 0.4, 1e-6);
    EXPECT_NEAR(extended[0][1234], recordings[0].output.values[1234], 1e-6);
  }
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
