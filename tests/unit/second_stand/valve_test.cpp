#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "tests/unit/second_stand/nominal.h"

namespace valvetriage::second_stand {
namespace {

std::size_t sample_at(double t_s) {
  return static_cast<std::size_t>(std::lround(200 * t_s));
}

TEST(Valve, NothingDriftsAtRest) {
  const auto pressure = played("step_up");
  for (std::size_t k = sample_at(0.1); k < sample_at(1.5); ++k) EXPECT_NEAR(pressure[k], pressure[0], 1e-3);
  for (std::size_t k = sample_at(4); k < pressure.size(); ++k) EXPECT_NEAR(pressure[k], pressure.back(), 1e-3);
}

TEST(Valve, SettlesWhereItsSteadyMapSays) {
  const auto pressure = played("staircase");
  // half of the 4.5 mA of loop and 1.2 mA of friction on slopes of up to 400 psi/A
  for (int level = 0; level < 5; ++level)
    EXPECT_NEAR(pressure[sample_at(1.9 + 1.8 * level + 1.7)], steady_psi(nominal_unit(), {}, 1.2 + 0.2 * level), 1.6)
        << level;
}

TEST(Valve, SlowCyclesCloseTheirLoop) {
  const auto pressure = played("triangle_fast");
  for (int k = 0; k < 600; ++k)  // the fourth cycle of 3 s is the fifth
    EXPECT_NEAR(pressure[sample_at(1 + 9) + static_cast<std::size_t>(k)],
                pressure[sample_at(1 + 12) + static_cast<std::size_t>(k)], 0.02);
}

TEST(Valve, PastIsForgottenAfterAFullSwing) {
  std::vector<double> instant_s, value_a;
  const auto go = [&](double from_a, double to_a) {
    for (int k = 0; k < 200; ++k) {
      instant_s.push_back(0.005 * static_cast<double>(instant_s.size()));
      value_a.push_back(from_a + (to_a - from_a) * k / 200);
    }
  };
  for (const auto& [from_a, to_a] : {std::pair{1.6, 1.6}, {1.6, 2.2}, {2.2, 0.8}, {0.8, 1.6}, {1.6, 1.6}})
    go(from_a, to_a);
  const Command command = given_command("swing", instant_s, value_a);
  const auto one = play_valve(nominal_unit(), {}, command, Day(1, "swing", 0));
  const auto other = play_valve(nominal_unit(), {}, command, Day(5, "swing", 0));
  EXPECT_GT(std::abs(one[100] - other[100]), 1);
  EXPECT_NEAR(one.back(), other.back(), 0.002);
}

TEST(Valve, HalfTheStepMovesTheOutputByLessThanAFiftiethOfTheNoise) {
  for (const std::string& test : full_session()) {
    const Command command = commands_of(test).front();
    const Day day(7, command.name, 0);
    const auto usual = play_valve(nominal_unit(), {}, command, day);
    const auto fine = play_valve(nominal_unit(), {}, command, day, 0, 0.5 * kStepS);
    EXPECT_LT(rms_difference(usual, fine), 0.02 * Conditions{}.noise_psi) << test;
  }
}

TEST(Valve, StepIsSeenAfterTheLatencyAndSettlesWithinASecond) {
  const auto pressure = played("step_up");
  const std::size_t step = sample_at(1.5);
  EXPECT_NEAR(pressure[step], pressure[step - 1], 1e-3);
  EXPECT_GT(pressure[step + 4], pressure[step] + 0.5);
  EXPECT_NEAR(pressure[step + 200], pressure.back(), 0.05);
}

TEST(Valve, DitherNarrowsTheLoopOfASticker) {
  Faults sticking;
  sticking.breakaway_a = 0.003;
  sticking.kinetic_a = 0.0025;
  const Command command = commands_of("triangle").front();
  const Day day(7, command.name, 0);
  const auto width = [&](double dither_a) {  // mean over the rising and falling ramp, 1.5 A to 1.7 A
    const auto pressure = play_valve(nominal_unit(), sticking, command, day, dither_a);
    double sum = 0;
    for (double from_rest_s = 4.5; from_rest_s < 6.3; from_rest_s += 0.005)
      sum += pressure[sample_at(19 - from_rest_s)] - pressure[sample_at(1 + from_rest_s)];
    return sum / 360;
  };
  EXPECT_LT(width(0.15), width(0) - 0.5);
}

}  // namespace
}  // namespace valvetriage::second_stand
