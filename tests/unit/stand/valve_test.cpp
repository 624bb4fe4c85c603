#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/stand/played.h"

namespace valvetriage::stand {
namespace {

/// Nominal unit without memory and friction: its steady levels do not depend on where it came from.
Unit memoryless() {
  Unit unit;
  unit.loop_width_a = 0;
  unit.breakaway_a = 0;
  return unit;
}

TEST(Valve, NominalUnitSettlesAtThePublishedLevels) {
  const double levels_psi[] = {3.1, 26, 120, 160, 210};
  const auto commands = commands_of("step");
  for (std::size_t i = 0; i < 5; ++i)  // 0.02 psi: what the tabulated port and 4 s of settling leave
    EXPECT_NEAR(settled_psi(play(memoryless(), commands[i])), levels_psi[i], 0.02);
}

TEST(Valve, SteadyMapRisesEverywhere) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const Unit unit = draw_unit(seed);
    for (double current_a = 0.8; current_a < 2.1; current_a += 0.005)
      EXPECT_LT(steady_pressure_psi(unit, current_a), steady_pressure_psi(unit, current_a + 0.005)) << seed;
  }
}

TEST(Valve, HealthyLoopMovesTheLevelsByLessThanItsWidth) {
  // Half of 4 mA of loop and 1 mA of friction on the steepest slope of the map, about 600 psi/A.
  EXPECT_NEAR(settled_psi(play(Unit{}, commands_of("step")[2])), 120, 0.003 * 600);
}

TEST(Valve, StepRisesWithinTheRangeOfARealValve) {
  for (const Command& command : commands_of("step")) {
    const auto pressure = play(Unit{}, command);
    const double low = pressure[290], high = settled_psi(pressure);
    const auto crossing = [&](double share) {
      std::size_t k = 300;
      while (pressure[k] < low + share * (high - low)) ++k;
      return static_cast<double>(k) * command.period_s;
    };
    const double rise_s = crossing(0.9) - crossing(0.1);
    EXPECT_GT(rise_s, 0.02) << command.name;
    EXPECT_LT(rise_s, 0.3) << command.name;
  }
}

TEST(Valve, OutputMovesOnlyAfterTheDelay) {
  const auto pressure = play(Unit{}, commands_of("step")[4]);
  EXPECT_NEAR(pressure[300], pressure[299], 0.01);  // the command jumps at sample 300, 4 ms before the coil sees it
  EXPECT_GT(pressure[303], pressure[299] + 0.1);
}

TEST(Valve, SlowRampOfAStickingSpoolGoesInSlips) {
  Faults sticking;
  sticking.breakaway_a = 0.03;
  sticking.kinetic_a = 0.018;
  const auto turns = [](const std::vector<double>& pressure) {
    int count = 0;  // changes of sign of the acceleration, on the rising ramp at mid range
    for (std::size_t k = 1000; k < 1400; ++k) {
      const double before = pressure[k] - 2 * pressure[k - 1] + pressure[k - 2];
      const double after = pressure[k + 1] - 2 * pressure[k] + pressure[k - 1];
      count += before * after < 0;
    }
    return count;
  };
  const Command ramp = commands_of("triangle")[0];
  EXPECT_LT(turns(play(Unit{}, ramp)), 12);
  EXPECT_GT(turns(play(Unit{}, ramp, sticking)), 20);
}

TEST(Valve, MagneticLoopIsAsWideAsItsParameterSays) {
  Unit unit = memoryless();
  unit.loop_width_a = 0.02;
  const Command slow = commands_of("triangle")[0];
  const auto pressure = play(unit, slow);
  // The delays of the chain, about 80 ms at mid range, widen the loop of a triangle of 1/9 A/s as well: subtract them.
  const auto straight = play(memoryless(), slow);
  const auto width_a = [&](const std::vector<double>& p) {
    std::size_t up = 200, down = 2000;
    while (p[up] < 120) ++up;
    while (p[down] > 120) ++down;
    return slow.value_a[down] - slow.value_a[up];
  };
  EXPECT_NEAR(std::abs(width_a(pressure) - width_a(straight)), 0.02, 0.0015);  // samples are 0.56 mA apart, twice
}

TEST(Valve, HalvedToleranceMovesTheOutputByLessThanAFiftiethOfTheNoise) {
  const Tolerance fine{0.5 * Tolerance{}.absolute, 0.5 * Tolerance{}.relative};
  for (const std::string& test : full_session())
    for (const Command& command : commands_of(test))
      EXPECT_LT(rms_difference(play(Unit{}, command), play(Unit{}, command, {}, fine)), 0.02 * 0.35) << command.name;
}

TEST(Valve, HealthyPopulationSpreadsAndStaysHealthy) {
  double sum = 0, squares = 0;
  constexpr int kUnits = 200;
  for (std::uint64_t seed = 0; seed < kUnits; ++seed) {
    const double level = steady_pressure_psi(draw_unit(seed), 1.6);
    sum += level;
    squares += level * level;
  }
  const double mean = sum / kUnits, sd = std::sqrt(squares / kUnits - mean * mean);
  // 0.8 % of gain, 3 mA and 1.5 mA of shifts on about 350 psi/A: 1.5 psi; four standard errors of 200 units about it
  EXPECT_NEAR(mean, 120, 0.6);
  EXPECT_GT(sd, 0.9);
  EXPECT_LT(sd, 2.6);
}

TEST(Valve, PastOfTheUnitIsForgottenAfterTheFirstFullSwing) {
  const Command command = commands_of("triangle_fast")[0];
  const auto times = sample_times_s(command);
  const Environment one(1, command.name), other(2, command.name);
  const auto a = run_valve(Unit{}, {}, command, one, times), b = run_valve(Unit{}, {}, command, other, times);
  double early = 0, late = 0;
  for (std::size_t k = 0; k < a.size(); ++k)
    (k < 500 ? early : late) = std::max(k < 500 ? early : late, std::abs(a[k] - b[k]));
  EXPECT_GT(early, 10 * late);
}

}  // namespace
}  // namespace valvetriage::stand
