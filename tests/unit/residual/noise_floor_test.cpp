#include "core/residual/noise_floor.h"

#include <gtest/gtest.h>

#include "tests/unit/residual/recordings.h"

namespace valvetriage {
namespace {

double lag(double t) {
  return 100 * (1 - std::exp(-t / 0.15));
}

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
