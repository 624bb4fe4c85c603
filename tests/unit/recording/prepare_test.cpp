#include "core/recording/prepare.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "core/recording/intersample.h"
#include "core/recording/limits.h"
#include "tests/unit/recording/signals.h"

namespace valvetriage {
namespace {

Result<Recording> tried(RawRecording raw) {
  return prepare_recording(std::move(raw), {});
}

Signal step_command() {
  return steps_of({1.0, 1.4, 1.0, 1.8, 1.0}, 400);
}

TEST(Prepare, LeavesAGoodNoisyRecordingWithoutAnyQualityItem) {
  for (unsigned seed = 0; seed < 60; ++seed) {
    for (const Signal& command : {step_command(), steps_of({1, 1.2, 1.4, 1.6, 1.8, 2.0, 1.6, 1.2}, 300),
                                  triangle_of(4000, 2000), swept_sine_of(4000), multisine_of(4000, seed)}) {
      const auto recording = tried(recorded(command, seed));
      ASSERT_TRUE(recording) << recording.error().message;
      EXPECT_TRUE(recording->quality.empty())
          << recording->quality.front().code << ": " << recording->quality.front().detail << ", seed " << seed;
      EXPECT_TRUE(recording->valid.empty());
    }
  }
}

TEST(Prepare, LeavesANoiseFreeRecordingWithoutAnyQualityItem) {
  for (const Signal& command : {step_command(), triangle_of(4000, 2000), swept_sine_of(4000)}) {
    const auto recording = tried(raw_of(command, response_of(command)));
    ASSERT_TRUE(recording);
    EXPECT_TRUE(recording->quality.empty()) << recording->quality.front().detail;
  }
}

TEST(Prepare, KeepsUniformStampsAndSamplesAsTheyAre) {
  const RawRecording raw = recorded(step_command(), 1);
  const auto recording = tried(raw);
  EXPECT_EQ(recording->output.values, raw.output.values);
  EXPECT_EQ(recording->time_s, raw.time.values);
  EXPECT_NEAR(recording->sample_rate_hz(), 200, 1e-9);
  EXPECT_TRUE(recording->test_inferred);
  EXPECT_EQ(recording->test, TestKind::kStep);
}

TEST(Prepare, SeesAUniformClockBehindRoundedStamps) {
  RawRecording raw = recorded(step_command(), 1);
  for (std::size_t i = 0; i < raw.time.values.size(); ++i) {
    raw.time.values[i] = std::round(static_cast<double>(i) / 300.0 * 1000) / 1000;  // 300 Hz in whole milliseconds
  }
  const auto recording = tried(raw);
  ASSERT_TRUE(recording);
  EXPECT_EQ(find_quality(*recording, "jitter"), nullptr);
  EXPECT_NEAR(recording->sample_rate_hz(), 300, 0.05);
  EXPECT_EQ(recording->output.values, raw.output.values);
}

TEST(Prepare, ResamplesJitteredStampsAndHoldsTheInputAcrossItsStep) {
  RawRecording raw = raw_of(step_command(), {});
  std::mt19937 random(7);
  std::uniform_real_distribution<double> jitter(-0.001, 0.001);
  for (double& stamp : raw.time.values) stamp += jitter(random);
  for (const double stamp : raw.time.values) raw.output.values.push_back(std::sin(stamp));
  const auto recording = tried(raw);
  ASSERT_TRUE(recording) << recording.error().message;
  const QualityItem* item = find_quality(*recording, "jitter");
  ASSERT_NE(item, nullptr);
  EXPECT_GT(item->count, 1000u);
  EXPECT_NE(item->detail.find("% of the sampling period"), std::string::npos) << item->detail;
  for (std::size_t i = 0; i < recording->samples(); ++i) {
    const double u = recording->input.values[i];
    EXPECT_TRUE(u == 1.0 || u == 1.4 || u == 1.8) << u;
    // straight at the ends, a sine over 7 ms: h²/8, and the grid's start is the first stamp
    const double at = recording->start_s + static_cast<double>(i) * recording->sample_period_s;
    EXPECT_NEAR(recording->output.values[i], std::sin(at), 1.5e-3);
  }
}

/// Stamps at 200 Hz that a clock jitters by a fifth of a period, at most by 45 % of one: every twentieth interval is
/// longer than one and a half.
RawRecording jittering(unsigned seed) {
  RawRecording raw = recorded(swept_sine_of(4000), 4);
  std::mt19937 random(seed);
  std::normal_distribution<double> jitter(0, 0.001);
  for (double& stamp : raw.time.values) stamp += std::clamp(jitter(random), -0.00225, 0.00225);
  return raw;
}

TEST(Prepare, ALongIntervalOfAClockThatJittersLosesNoRow) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    const auto recording = tried(jittering(seed));
    ASSERT_TRUE(recording) << recording.error().message;
    EXPECT_EQ(find_quality(*recording, "gap"), nullptr) << seed;
    ASSERT_NE(find_quality(*recording, "jitter"), nullptr) << seed;
    EXPECT_NEAR(recording->sample_rate_hz(), 200, 0.05) << seed;
    for (std::size_t i = 0; i < recording->samples(); ++i) ASSERT_TRUE(recording->is_valid(i)) << seed << ", " << i;
  }
}

TEST(Prepare, ALostRowOfAClockThatJittersIsAGap) {
  for (const unsigned seed : {1u, 2u, 3u}) {
    RawRecording raw = jittering(seed);
    for (auto* values : {&raw.time.values, &raw.input.values, &raw.output.values}) {
      values->erase(values->begin() + 2000, values->begin() + 2003);
      values->erase(values->begin() + 1000);
    }
    const auto recording = tried(raw);
    ASSERT_TRUE(recording) << recording.error().message;
    for (const std::size_t lost : {1000u, 2000u, 2001u, 2002u}) {  // the grid begins at the first stamp, which jitters
      EXPECT_FALSE(recording->is_valid(lost) && recording->is_valid(lost + 1)) << seed << ", " << lost;
    }
    // A long interval right beside a gap may be taken for another.
    const QualityItem* item = find_quality(*recording, "gap");
    ASSERT_NE(item, nullptr) << seed;
    EXPECT_LE(item->count, 6u) << seed << ": " << item->detail;
    EXPECT_NEAR(recording->sample_rate_hz(), 200, 0.05) << seed;
  }
}

TEST(Prepare, FillsGapsMarksThemAndSaysWhere) {
  RawRecording raw = recorded(step_command(), 4);
  for (auto* values : {&raw.time.values, &raw.input.values, &raw.output.values}) {
    values->erase(values->begin() + 1000, values->begin() + 1010);
    values->erase(values->begin() + 500, values->begin() + 501);
  }
  const auto recording = tried(raw);
  ASSERT_TRUE(recording);
  const QualityItem* item = find_quality(*recording, "gap");
  ASSERT_NE(item, nullptr);
  EXPECT_EQ(item->count, 11u);
  EXPECT_NE(item->detail.find("2 gaps, the longest 0.055 s, the first after 2.495 s"), std::string::npos)
      << item->detail;
  EXPECT_EQ(recording->samples(), 2000u);
  EXPECT_FALSE(recording->is_valid(500));
  EXPECT_TRUE(recording->is_valid(499));
  EXPECT_TRUE(recording->is_valid(501));
  EXPECT_EQ(find_quality(*recording, "jitter"), nullptr);
}

TEST(Prepare, RefusesATimeBaseThatNoGridDescribes) {
  RawRecording mostly_missing = recorded(step_command(), 4);
  for (std::size_t i = 1000; i < 2000; ++i) mostly_missing.time.values[i] += 1e6;
  EXPECT_EQ(tried(mostly_missing).error().code, "irregular_time");

  RawRecording random = recorded(step_command(), 4);
  std::mt19937 generator(1);
  std::exponential_distribution<double> wait(200);
  double now = 0;
  for (double& stamp : random.time.values) stamp = now += wait(generator) + 1e-6;
  EXPECT_EQ(tried(random).error().code, "irregular_time");
}

TEST(Prepare, RefusesWhatCannotBeAnalysed) {
  RawRecording back = recorded(step_command(), 1);
  back.time.values[700] = back.time.values[699];
  EXPECT_EQ(tried(back).error().code, "time_not_increasing");
  EXPECT_EQ(tried(back).error().file, "valve.csv");

  RawRecording nan = recorded(step_command(), 1);
  nan.output.values[3] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(tried(nan).error().code, "not_finite");

  RawRecording huge = recorded(step_command(), 1);
  const double most = *std::ranges::max_element(huge.output.values);
  for (double& value : huge.output.values) value *= kMostMagnitude / most;
  EXPECT_TRUE(tried(huge));
  *std::ranges::max_element(huge.output.values) *= 1.001;
  EXPECT_EQ(tried(huge).error().code, "out_of_range");
  EXPECT_EQ(tried(huge).error().file, "valve.csv");

  RawRecording short_column = recorded(step_command(), 1);
  short_column.output.values.pop_back();
  EXPECT_EQ(tried(short_column).error().code, "ragged_columns");

  EXPECT_EQ(tried(raw_of({}, {})).error().code, "no_samples");
  EXPECT_EQ(tried(raw_of(triangle_of(kMinSamples - 1, 10), Signal(kMinSamples - 1, 0))).error().code,
            "too_few_samples");
  EXPECT_TRUE(tried(raw_of(triangle_of(kMinSamples, 10), response_of(triangle_of(kMinSamples, 10)))));
}

TEST(Prepare, RefusesAConstantInputNoisyOrNot) {
  EXPECT_EQ(tried(raw_of(Signal(500, 1.4), triangle_of(500, 100))).error().code, "constant_input");
  for (unsigned seed = 0; seed < 20; ++seed) {
    EXPECT_EQ(tried(recorded(Signal(4000, 1.4), seed)).error().code, "constant_input") << "seed " << seed;
  }
  EXPECT_TRUE(tried(recorded(steps_of({1.4, 1.41}, 400), 1)));
}

TEST(Prepare, TakesTheTestOfTheMetadataBeforeItsOwn) {
  RawRecording raw = recorded(step_command(), 1);
  raw.metadata.test = "other";
  EXPECT_EQ(tried(raw)->test, TestKind::kOther);
  EXPECT_FALSE(tried(raw)->test_inferred);
}

/// The stand's command read by a clock that jitters by up to a third of a period.
RawRecording jittered(const Signal& command, unsigned seed) {
  RawRecording raw = raw_of(command, response_of(command));
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> jitter(-0.0016, 0.0016);
  for (double& stamp : raw.time.values) stamp += jitter(random);
  return raw;
}

TEST(Prepare, KnowsWhereBetweenTwoGridSamplesAStepOfAJitteringRecordingLies) {
  const RawRecording raw = jittered(step_command(), 3);
  const auto recording = tried(raw);
  ASSERT_TRUE(recording) << recording.error().message;
  ASSERT_EQ(recording->jumps.size(), 4u);
  const IntervalSignal between = input_between_samples(*recording);
  for (std::size_t j = 0; j < 4; ++j) {
    const InputJump& jump = recording->jumps[j];
    const double at =
        recording->start_s + (static_cast<double>(jump.interval) + jump.fraction) * recording->sample_period_s;
    EXPECT_NEAR(at, raw.time.values[400 * (j + 1)], 1e-9);
    EXPECT_FALSE(jump.in_gap);
    const double before = recording->input.values[jump.interval], after = recording->input.values[jump.interval + 1];
    EXPECT_NEAR(between.start[jump.interval], before + (1 - jump.fraction) * (after - before), 1e-12);
    EXPECT_EQ(between.end[jump.interval], between.start[jump.interval]);
  }
}

TEST(Prepare, ASteepSineIsNoRowOfSteps) {
  const RawRecording raw = jittered(swept_sine_of(4000), 4);
  const auto recording = tried(raw);
  ASSERT_TRUE(recording) << recording.error().message;
  EXPECT_TRUE(recording->jumps.empty());
}

TEST(Prepare, AcrossAGapASineKeepsItsCurve) {
  RawRecording raw = recorded(swept_sine_of(4000), 5);
  const Signal whole = raw.input.values;
  for (Signal* column : {&raw.time.values, &raw.input.values, &raw.output.values}) {
    column->erase(column->begin() + 3001, column->begin() + 3006);
  }
  const auto recording = tried(raw);
  ASSERT_TRUE(recording) << recording.error().message;
  double straight = 0, curved = 0;
  for (std::size_t i = 3001; i < 3006; ++i) {
    const double share = static_cast<double>(i - 3000) / 6;
    straight = std::max(straight, std::abs(whole[3000] + share * (whole[3006] - whole[3000]) - whole[i]));
    curved = std::max(curved, std::abs(recording->input.values[i] - whole[i]));
  }
  EXPECT_LT(curved, 0.3 * straight);
}

/// A recording with five rows lost from `first` on.
Recording with_gap(const Signal& command, std::ptrdiff_t first) {
  RawRecording raw = recorded(command, 6);
  for (Signal* column : {&raw.time.values, &raw.input.values, &raw.output.values}) {
    column->erase(column->begin() + first, column->begin() + first + 5);
  }
  return tried(raw).value();
}

TEST(Prepare, WhatFollowsAStepThatIsLostInAGapIsLeftOut) {
  Recording recording = with_gap(step_command(), 398);
  ASSERT_EQ(recording.jumps.size(), 4u);
  EXPECT_TRUE(recording.jumps[0].in_gap);
  EXPECT_GT(leave_out_lost_input(recording, 0.25), 40u);
  EXPECT_TRUE(recording.is_valid(397));
  EXPECT_FALSE(recording.is_valid(440));
  EXPECT_TRUE(recording.is_valid(460));
}

TEST(Prepare, WhatFollowsAGapInACurveIsLeftOutAndInAHoldKept) {
  Recording curve = with_gap(swept_sine_of(4000), 3500);
  EXPECT_GT(leave_out_lost_input(curve, 0.25), 40u);
  Recording hold = with_gap(step_command(), 600);
  EXPECT_EQ(leave_out_lost_input(hold, 0.25), 0u);
  EXPECT_TRUE(hold.is_valid(610));
}

}  // namespace
}  // namespace valvetriage
