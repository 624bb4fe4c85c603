#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/unit/stand/played.h"

namespace valvetriage::stand {
namespace {

Session with(const std::string& decoy, double size = 0, std::vector<std::string> tests = {"sweep"}) {
  SessionOptions options = session_of(std::move(tests));
  options.decoys = {{decoy, size}};
  return run_session(options);
}

/// Noise of the first recording and its correlation from one sample to the next.
struct NoiseFigures {
  double rms, correlation;
};
NoiseFigures noise_of(const StandRecording& recording) {
  double squares = 0, products = 0;
  for (std::size_t k = 1; k < recording.clean_psi.size(); ++k) {
    const double now = recording.pressure_psi[k] - recording.clean_psi[k];
    const double before = recording.pressure_psi[k - 1] - recording.clean_psi[k - 1];
    squares += now * now;
    products += now * before;
  }
  return {std::sqrt(squares / static_cast<double>(recording.clean_psi.size() - 1)), products / squares};
}

TEST(Acquisition, NoiseIsWhiteAndAsLargeAsAskedFor) {
  const NoiseFigures noise = noise_of(run_session(session_of({"sweep"})).recordings[0]);
  EXPECT_NEAR(noise.rms, 0.35, 4 * 0.35 / std::sqrt(2 * 4000.0));  // four standard errors of an rms of 4,000 samples
  EXPECT_NEAR(noise.correlation, 0, 4 / std::sqrt(4000.0));
}

TEST(Acquisition, ColouredNoiseKeepsItsRmsAndRemembers) {
  const NoiseFigures noise = noise_of(with("coloured_noise", 0.03).recordings[0]);
  const double memory = std::exp(-0.005 / 0.03);
  // The samples that count as independent are fewer by (1 + m²) / (1 − m²).
  const double effective = 4000 * (1 - memory * memory) / (1 + memory * memory);
  EXPECT_NEAR(noise.rms, 0.35, 4 * 0.35 / std::sqrt(2 * effective));
  EXPECT_NEAR(noise.correlation, memory, 0.05);
}

TEST(Acquisition, QuantisedChannelsShowWholeSteps) {
  const StandRecording recording = with("quantised_adc", 0.5).recordings[0];
  for (const double pressure : recording.pressure_psi) EXPECT_EQ(pressure, 0.5 * std::round(pressure / 0.5));
}

TEST(Acquisition, JitteredStampsAreTrueAndInOrder) {
  const StandRecording recording = with("jitter").recordings[0];
  const Command command = commands_of("sweep")[0];
  bool moved = false;
  for (std::size_t k = 0; k < recording.time_s.size(); ++k) {
    if (k > 0) {
      EXPECT_GT(recording.time_s[k], recording.time_s[k - 1]);
    }
    moved = moved || std::abs(recording.time_s[k] - 0.005 * static_cast<double>(k)) > 1e-4;
    EXPECT_EQ(recording.command_a[k], command.value_a[k]);  // played at the instant it is sampled
  }
  EXPECT_TRUE(moved);
}

TEST(Acquisition, DropOutsTakeWholeRowsAway) {
  const StandRecording recording = with("dropouts", 60).recordings[0];
  EXPECT_LT(recording.time_s.size(), 4000u);
  EXPECT_GE(recording.time_s.size(), 3940u);
  EXPECT_EQ(recording.pressure_psi.size(), recording.time_s.size());
  EXPECT_EQ(recording.clean_psi.size(), recording.time_s.size());
}

TEST(Acquisition, RippleAliasesIntoTheCurrentAndNotIntoThePressure) {
  const Session plain = run_session(session_of({"sweep"})), rippled = with("pwm_ripple", 0.01);
  EXPECT_EQ(plain.recordings[0].clean_psi, rippled.recordings[0].clean_psi);
  double in_phase = 0, quadrature = 0;  // the ripple of 997.3 Hz shows at 2.7 Hz
  for (std::size_t k = 0; k < 4000; ++k) {
    const double difference = rippled.recordings[0].current_a[k] - plain.recordings[0].current_a[k];
    const double phase = 2 * std::numbers::pi * 2.7 * 0.005 * static_cast<double>(k);
    in_phase += difference * std::cos(phase) / 2000;
    quadrature += difference * std::sin(phase) / 2000;
  }
  EXPECT_NEAR(std::hypot(in_phase, quadrature), 0.001, 1e-4);
}

TEST(Acquisition, DitherNarrowsTheFrictionLoop) {
  SessionOptions sticking = session_of({"triangle"}, {{"friction", 0.01}});
  const double without = signature_psi(sticking);
  sticking.decoys = {{"dither", 0.05}};
  EXPECT_LT(signature_psi(sticking), 0.9 * without);
}

TEST(Acquisition, MovingSetPointIsInTheLog) {
  const Session plain = run_session(session_of({"steps"})), moving = with("moving_setpoint", 0.02, {"steps"});
  EXPECT_GT(rms_difference(plain.recordings[0].current_a, moving.recordings[0].current_a), 0.003);
  EXPECT_GT(rms_difference(plain.recordings[0].clean_psi, moving.recordings[0].clean_psi), 0.5);
}

TEST(Acquisition, UnknownDecoyIsRefused) {
  EXPECT_THROW(with("gremlin"), std::invalid_argument);
}

TEST(Command, MultisineExcitesOddLinesAloneAndLeavesSomeOut) {
  constexpr double kPeriodS = 5;
  const auto signal = multisine(0.005, kPeriodS, 15, 1);
  const auto amplitude = [&](int line) {
    double in_phase = 0, quadrature = 0;
    for (std::size_t k = 0; k < signal.size(); ++k) {
      const double phase = 2 * std::numbers::pi * line * static_cast<double>(k) / static_cast<double>(signal.size());
      in_phase += signal[k] * std::cos(phase);
      quadrature += signal[k] * std::sin(phase);
    }
    return 2 * std::hypot(in_phase, quadrature) / static_cast<double>(signal.size());
  };
  int excited = 0, left_out = 0;
  for (int line = 1; line <= 70; ++line) {
    const double a = amplitude(line);
    if (line % 2 == 1) {
      ++(a > 1e-9 ? excited : left_out);
    } else {
      EXPECT_LT(a, 1e-9) << line;
    }
  }
  EXPECT_GE(excited, 20);
  EXPECT_GE(left_out, 6);
}

TEST(Command, JitteringClockMovesTheCommandWithItsSamples) {
  Command command = command_of_samples("given", 0.01, {1.0, 1.0, 1.5, 1.5, 1.6, 1.7, 1.8});
  command.tick_s = {0.004, 0.006, 0.0245, 0.0255, 0.0444, 0.0456, 0.06};
  for (std::size_t k = 0; k < command.tick_s.size(); ++k) {
    EXPECT_DOUBLE_EQ(command.at(command.tick_s[k]), command.value_a[k]);
    EXPECT_EQ(command.index_at(command.tick_s[k] + 1e-6), k);
  }
  EXPECT_DOUBLE_EQ(command.at(0.0244), 1.0);
  EXPECT_NEAR(command.at(0.045), 1.65, 1e-9);
}

TEST(Command, FullSessionIsSixRecordingsOfFourThousandSamples) {
  for (const std::string& test : full_session()) {
    ASSERT_EQ(commands_of(test).size(), 1u);
    EXPECT_EQ(commands_of(test)[0].value_a.size(), 4000u) << test;
    EXPECT_EQ(commands_of(test)[0].is_step.size(), 4000u) << test;
  }
}

TEST(Command, StepIsHeldUntilItsSampleAndARampIsStraight) {
  const Command given = command_of_samples("given", 0.01, {1.0, 1.0, 1.5, 1.5, 1.6, 1.7, 1.8});
  EXPECT_DOUBLE_EQ(given.at(0.0199), 1.0);
  EXPECT_DOUBLE_EQ(given.at(0.02), 1.5);
  EXPECT_DOUBLE_EQ(given.at(0.045), 1.65);
}

}  // namespace
}  // namespace valvetriage::stand
