#include "core/recording/intersample.h"
#include "core/recording/segments.h"
#include "core/recording/white_noise.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <random>

namespace valvetriage {
namespace {

constexpr double kNoise_a = 0.0006;
constexpr std::size_t kSamples = 4000;

/// 20 s at 200 Hz of a command with white noise in its log; `steps` are where the command jumps.
Recording recording_of(const std::function<double(std::size_t)>& command, double noise_a,
                       const std::vector<std::size_t>& steps = {}) {
  std::mt19937_64 random(11);
  std::normal_distribution<double> noise(0, 1);
  Recording recording;
  recording.sample_period_s = 0.005;
  for (std::size_t i = 0; i < kSamples; ++i) recording.input.values.push_back(command(i) + noise_a * noise(random));
  recording.output.values = recording.input.values;
  for (const std::size_t at : steps)
    recording.segments.push_back({.kind = SegmentKind::kStep, .begin = at, .end = at + 1});
  return recording;
}

double rms_error(const IntervalSignal& input, const std::function<double(std::size_t)>& command, std::size_t first,
                 std::size_t last) {
  double squares = 0;
  for (std::size_t i = first; i < last; ++i) squares += std::pow(input.start[i] - command(i), 2);
  return std::sqrt(squares / static_cast<double>(last - first));
}

double held(std::size_t i) {
  return i < 2000 ? 1.0 : 1.6;
}
double triangle(std::size_t i) {
  const double t = static_cast<double>(i) * 0.005;
  return 1 + 0.1 * (t < 10 ? t : 20 - t);
}
double sine(std::size_t i) {
  return 1.5 + 0.2 * std::sin(2 * std::numbers::pi * 10 * static_cast<double>(i) * 0.005);
}
double slow_sine(std::size_t i) {
  return 1.5 + 0.2 * std::sin(2 * std::numbers::pi * static_cast<double>(i) * 0.005);
}

TEST(InputBetweenSamples, OfAHeldCommandStaysWhereEachSampleHasIt) {
  const Recording recording = recording_of(triangle, 0);
  const IntervalSignal held_on = input_between_samples(recording, InputBetween::kHeld);
  EXPECT_EQ(held_on.start, recording.input.values);
  EXPECT_EQ(held_on.end, held_on.start);
  EXPECT_EQ(noise_free_input(recording, InputBetween::kHeld).end, held_on.end);
  EXPECT_EQ(input_between_samples(recording).end[0], recording.input.values[1]);
}

TEST(NoiseFreeInput, OfACleanLogIsTheLogToTheLastBit) {
  for (const auto& command : {std::function(held), std::function(sine)}) {
    const Recording recording = recording_of(command, 0, {2000});
    EXPECT_EQ(noise_free_input(recording).start, input_between_samples(recording).start);
    EXPECT_EQ(noise_free_input(recording).end, input_between_samples(recording).end);
  }
}

// A set point that wanders makes ramps of a staircase's levels: its jumps are commands all the same, and half a sample
// of one is eight times the noise of the pressure.
TEST(InputBetweenSamples, HoldsACommandUntilItJumpsThoughItMovesOnFromThere) {
  const auto wandering = [](std::size_t i) { return held(i) + 0.06 * static_cast<double>(i % 2000) / 2000; };
  Recording recording = recording_of(wandering, kNoise_a);
  recording.segments = find_segments(recording.input.values, recording.sample_period_s);
  ASSERT_EQ(recording.segments.size(), 2u);
  EXPECT_EQ(recording.segments[1].kind, SegmentKind::kRamp);
  const IntervalSignal input = input_between_samples(recording);
  EXPECT_EQ(input.end[1999], input.start[1999]);
  EXPECT_EQ(input.end[1998], input.start[1999]);
  EXPECT_EQ(input.end[2000], input.start[2001]);
}

TEST(NoiseFreeInput, OnAHoldIsTheHold) {
  const IntervalSignal input = noise_free_input(recording_of(held, kNoise_a, {2000}));
  EXPECT_LT(rms_error(input, held, 100, 1900), kNoise_a / 6);
  EXPECT_LT(rms_error(input, held, 2100, 3900), kNoise_a / 6);
}

TEST(NoiseFreeInput, LeavesAStepWhereItIsEvenWhereNoSegmentTellsOfIt) {
  for (const std::vector<std::size_t>& steps : {std::vector<std::size_t>{2000}, {}}) {
    const IntervalSignal input = noise_free_input(recording_of(held, kNoise_a, steps));
    EXPECT_NEAR(input.start[1999], 1.0, 4 * kNoise_a);
    EXPECT_NEAR(input.start[2000], 1.6, 4 * kNoise_a);
  }
}

TEST(NoiseFreeInput, OfASlowTriangleKeepsItsTips) {
  const IntervalSignal input = noise_free_input(recording_of(triangle, kNoise_a));
  EXPECT_LT(rms_error(input, triangle, 100, 1900), kNoise_a / 3);
  EXPECT_NEAR(input.start[2000], triangle(2000), 2 * kNoise_a);
}

TEST(NoiseFreeInput, OfACurveLosesMostOfItsNoise) {
  EXPECT_LT(rms_error(noise_free_input(recording_of(slow_sine, kNoise_a)), slow_sine, 0, kSamples), 0.6 * kNoise_a);
}

TEST(NoiseFreeInput, OfAFastSineAddsLittleToItsNoise) {
  EXPECT_LT(rms_error(noise_free_input(recording_of(sine, kNoise_a)), sine, 0, kSamples), 1.5 * kNoise_a);
}

TEST(WhiteNoise, OfASweepIsThatOfItsLog) {
  EXPECT_NEAR(white_noise(recording_of(triangle, kNoise_a).input.values), kNoise_a, 0.1 * kNoise_a);
  EXPECT_EQ(white_noise(std::vector<double>(7, 1.0)), 0);
}

TEST(Halved, IntervalsMeetHalfWayAndTheNoiseStaysThatOfTheSamples) {
  const IntervalSignal halves = halved({.start = {1, 2, 4}, .end = {1, 4, 4}, .noise = 0.5});
  EXPECT_EQ(halves.start, (std::vector<double>{1, 1, 2, 3, 4, 4}));
  EXPECT_EQ(halves.end, (std::vector<double>{1, 1, 3, 4, 4, 4}));
  EXPECT_EQ(at_samples(halves.start), (std::vector<double>{1, 2, 4}));
  EXPECT_EQ(halves.noise, 0.5);
  EXPECT_EQ(halved({.start = {1, 2}, .end = {2, 3}}).noise, white_noise(std::vector<double>{1, 2}));
}

}  // namespace
}  // namespace valvetriage
