#include "core/residual/noise_floor.h"

#include <gtest/gtest.h>

#include "tests/unit/residual/recordings.h"

namespace valvetriage {
namespace {

using test::lag;

TEST(NoiseFloor, IsTheNoiseOfAStepRecordingAndNotItsTransient) {
  const Recording recording = test::step_recording(200, 1.0, 1.6, 1, 5, lag, 0.35, 1);
  const NoiseFloor floor = noise_floor(recording);
  EXPECT_EQ(floor.method, NoiseFloorMethod::kHolds);
  // 400 settled samples: the standard error of an rms is 0.35 / sqrt(2 * 320) = 4 %, four of them allowed.
  EXPECT_NEAR(floor.rms, 0.35, 0.35 * 0.16);
}

TEST(NoiseFloor, SeesColouredNoiseOnHoldsWhole) {
  Recording recording = test::step_recording(200, 1.0, 1.6, 10, 20, lag, 0.0, 1);
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  double coloured = 0;
  const double pole = 0.8;
  for (double& y : recording.output.values) {
    coloured = pole * coloured + std::sqrt(1 - pole * pole) * normal(random);
    y += 0.5 * coloured;
  }
  // 1,600 samples with a correlation time of 9: about 180 independent ones, so 5 % standard error, four of them
  // allowed.
  EXPECT_NEAR(noise_floor(recording).rms, 0.5, 0.1);
}

/// Ten steps of random height, each held for 200 samples; a mode of 1 Hz that rings for 2.5 s, sampled at 100 Hz.
Recording ringing(double noise) {
  constexpr std::size_t kHold = 200, kSteps = 10;
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> level(-1, 1);
  Recording recording;
  recording.sample_period_s = 0.01;
  double y = 0, v = 0;
  for (std::size_t step = 0; step < kSteps; ++step) {
    const double u = level(random);
    for (std::size_t i = 0; i < kHold; ++i) {
      recording.time_s.push_back(0.01 * static_cast<double>(recording.time_s.size()));
      recording.input.values.push_back(u);
      recording.output.values.push_back(y + noise * normal(random));
      for (int sub = 0; sub < 100; ++sub) {
        v += 1e-4 * (39.5 * (u - y) - 0.8 * v);
        y += 1e-4 * v;
      }
    }
    recording.segments.push_back(
        {.kind = SegmentKind::kStep, .begin = step * kHold, .end = (step + 1) * kHold, .level = u});
  }
  return recording;
}

TEST(NoiseFloor, OfAMachineThatRingsFromStepToStepIsNotItsRinging) {
  const Recording recording = ringing(0.01), still = ringing(0);
  EXPECT_GT(noise_floor(recording).rms, 0.05);
  // A one-step prediction from eight noisy samples leaves up to half as much again as the noise.
  EXPECT_LT(noise_floor_of_ringing(recording, still.output.values).rms, 1.6 * 0.01);
  // Where a simulation stands still though the machine rings on, a prediction sees that the ringing brings nothing new:
  // 80 settled samples in each hold allow coloured noise to be twice as large as what a prediction leaves.
  const std::vector<double> settled(recording.samples(), 0.0);
  EXPECT_LT(noise_floor_of_ringing(recording, settled).rms, 2.5 * 0.01);
}

TEST(NoiseFloor, OfHoldsThatAgreeSeesColouredNoiseWholeBesideASimulation) {
  Recording recording = ringing(0);
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  double coloured = 0;
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    coloured = 0.8 * coloured + 0.6 * normal(random);
    recording.output.values[i] = 0.5 * coloured;
  }
  // 80 settled samples in each hold with a correlation time of 9; a line takes two freedoms of nine.
  EXPECT_NEAR(noise_floor_of_ringing(recording, std::vector<double>(recording.samples(), 0.0)).rms, 0.5, 0.15);
}

TEST(NoiseFloor, OfASweepIsNotItsAmplitude) {
  Recording recording = test::step_recording(
      200, 1.5, 1.5, 0.5, 20, [](double) { return 0.0; }, 0.35, 3);
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    const double t = recording.time_s[i];
    recording.output.values[i] += 60 * std::sin(2 * 3.141592653589793 * 2.0 * t);
  }
  recording.segments = {{.kind = SegmentKind::kSweep, .begin = 0, .end = recording.samples(), .level = 1.5}};
  const NoiseFloor floor = noise_floor(recording);
  // Third differences of 60 psi at 2 Hz, 200 Hz sampled: 60 (2π/100)³ = 0.015 psi, far below the noise.
  EXPECT_NEAR(floor.rms, 0.35, 0.03);
}

TEST(NoiseFloor, OfAResponseFastAgainstTheSamplingIsNotTheResponse) {
  // White input through a resonance at a quarter of the sampling rate: differences see nothing but signal.
  Recording recording = test::step_recording(
      200, 0, 0, 0.5, 20, [](double) { return 0.0; }, 0.0, 3);
  std::mt19937 random(17);
  std::normal_distribution<double> normal;
  double y1 = 0, y2 = 0;
  for (std::size_t i = 0; i < recording.samples(); ++i) {
    recording.input.values[i] = normal(random);
    const double y = -0.8 * y2 + recording.input.values[i];
    y2 = y1;
    y1 = y;
    recording.output.values[i] = y + 0.02 * normal(random);
  }
  recording.segments = {{.kind = SegmentKind::kSweep, .begin = 0, .end = recording.samples()}};
  const NoiseFloor floor = noise_floor(recording);
  EXPECT_EQ(floor.method, NoiseFloorMethod::kPrediction);
  // Eight lags predict output noise under a pole of modulus 0.89 to within 30 %; the response itself has an rms of 1.7.
  EXPECT_GT(floor.rms, 0.018);
  EXPECT_LT(floor.rms, 0.03);
}

TEST(NoiseFloor, OfAFrozenReadingIsItsResolution) {
  Recording recording = test::step_recording(200, 1.0, 1.6, 1, 5, lag, 0.0, 1);
  for (double& y : recording.output.values) y = 6.9 * std::round(y / 6.9);
  EXPECT_NEAR(noise_floor(recording).rms, 6.9 / std::sqrt(12.0), 1e-9);
}

}  // namespace
}  // namespace valvetriage
