#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "tests/stand/command.h"
#include "tests/stand/files.h"
#include "tests/stand/fleets.h"
#include "tests/stand/session.h"
#include "tests/stand/valve.h"

namespace valvetriage::stand {
namespace {

std::vector<double> times_of(const Command& command) {
  std::vector<double> times;
  for (std::size_t k = 0; k < command.value_a.size(); ++k) times.push_back(static_cast<double>(k) * command.period_s);
  return times;
}

std::vector<double> play(const Unit& unit, const Command& command, const Faults& faults = {},
                         const Tolerance& tolerance = {}) {
  return run_valve(unit, faults, command, 7, times_of(command), tolerance);
}

/// Nominal unit without memory and friction: its steady levels do not depend on where it came from.
Unit memoryless() {
  Unit unit;
  unit.loop_width_a = 0;
  unit.breakaway_a = 0;
  return unit;
}

/// Mean pressure over the last second of the hold at the level of a step recording.
double settled_psi(const std::vector<double>& pressure) {
  return std::accumulate(pressure.begin() + 900, pressure.begin() + 1100, 0.0) / 200;
}

double rms_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

SessionOptions short_session(std::vector<EffectRequest> effects = {}) {
  SessionOptions options;
  options.tests = {"step"};
  options.effects = std::move(effects);
  return options;
}

TEST(Stand, NominalUnitSettlesAtThePublishedLevels) {
  const double levels_psi[] = {3.1, 26, 120, 160, 210};
  const auto commands = commands_of("step");
  for (std::size_t i = 0; i < 5; ++i)  // 0.02 psi: what the tabulated port and 4 s of settling leave
    EXPECT_NEAR(settled_psi(play(memoryless(), commands[i])), levels_psi[i], 0.02);
}

TEST(Stand, HealthyLoopMovesTheLevelsByLessThanItsWidth) {
  const Unit nominal;
  // Half of 4 mA of loop and 1 mA of friction on the steepest slope of the map, about 600 psi/A.
  EXPECT_NEAR(settled_psi(play(nominal, commands_of("step")[2])), 120, 0.003 * 600);
}

TEST(Stand, StepRisesWithinTheRangeOfARealValve) {
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

TEST(Stand, EqualSeedsGiveEqualBytes) {
  const Session a = run_session(short_session()), b = run_session(short_session());
  for (std::size_t i = 0; i < a.recordings.size(); ++i)
    EXPECT_EQ(recording_csv(a.options, a.recordings[i]), recording_csv(b.options, b.recordings[i]));
}

TEST(Stand, AnotherDayIsTheSameValveWithOtherNoise) {
  SessionOptions other = short_session();
  other.noise_seed = 2;
  const Session a = run_session(short_session()), b = run_session(other);
  EXPECT_NE(a.recordings[0].pressure_psi, b.recordings[0].pressure_psi);
  EXPECT_EQ(a.unit.map_shift_a, b.unit.map_shift_a);
}

TEST(Stand, EffectOfSizeZeroChangesNoBit) {
  const Session healthy = run_session(short_session());
  for (const EffectInfo& info : effect_table()) {
    const Session spoiled = run_session(short_session({{info.effect, 0.0}}));
    for (std::size_t i = 0; i < healthy.recordings.size(); ++i)
      EXPECT_EQ(healthy.recordings[i].pressure_psi, spoiled.recordings[i].pressure_psi) << info.effect;
  }
}

TEST(Stand, EffectLeavesNoiseAndUnitAlone) {
  const Session healthy = run_session(short_session());
  const Session spoiled = run_session(short_session({{"sensor_offset", 3.0}}));
  for (std::size_t k = 0; k < 100; ++k)  // the offset and nothing else, to rounding
    EXPECT_NEAR(spoiled.recordings[0].pressure_psi[k] - healthy.recordings[0].pressure_psi[k], 3.0, 1e-9);
}

TEST(Stand, EveryEffectGrowsWithItsSize) {
  const Session healthy = run_session(short_session());
  const auto moved = [&](const EffectInfo& info, double size) {
    const Session spoiled = run_session(short_session({{info.effect, size}}));
    double sum = 0;
    for (std::size_t i = 0; i < healthy.recordings.size(); ++i)
      sum += rms_difference(healthy.recordings[i].clean_psi, spoiled.recordings[i].clean_psi);
    return sum;
  };
  for (const EffectInfo& info : effect_table()) {
    const double small = moved(info, info.malfunctioned_size), large = moved(info, info.severe_size);
    EXPECT_GT(small, 0.05) << info.effect;
    EXPECT_GT(large, 1.2 * small) << info.effect;
  }
}

TEST(Stand, FrictionHoldsTheSpoolBack) {
  Faults faults;
  faults.breakaway_a = 0.02;
  faults.kinetic_a = 0.014;
  const auto commands = commands_of("step");
  EXPECT_LT(settled_psi(play(Unit{}, commands[2], faults)), settled_psi(play(Unit{}, commands[2])) - 3);
}

TEST(Stand, LeakSettlesLowerAndMoreSoAtHighPressure) {
  Faults faults;
  faults.leak_fraction = 0.1;
  const auto commands = commands_of("step");
  const auto loss = [&](std::size_t i) {
    return settled_psi(play(Unit{}, commands[i])) - settled_psi(play(Unit{}, commands[i], faults));
  };
  EXPECT_GT(loss(1), 0.5);
  EXPECT_GT(loss(2), 2 * loss(1));
}

TEST(Stand, ExtraLagDelaysTheRiseAndKeepsTheLevel) {
  Faults faults;
  faults.extra_lag_s = 0.1;
  const Command command = commands_of("step")[2];
  const auto healthy = play(Unit{}, command), slow = play(Unit{}, command, faults);
  EXPECT_LT(slow[320], healthy[320] - 10);
  EXPECT_NEAR(settled_psi(slow), settled_psi(healthy), 0.01);  // 4 s of 0.1 s: e^-40
}

TEST(Stand, HalvedToleranceMovesTheOutputByLessThanATwentiethOfTheNoise) {
  const Tolerance fine{0.5 * Tolerance{}.absolute, 0.5 * Tolerance{}.relative};
  for (const char* test : {"step", "triangle", "sweep"})
    for (const Command& command : commands_of(test))
      EXPECT_LT(rms_difference(play(Unit{}, command), play(Unit{}, command, {}, fine)), 0.02 * 0.35) << command.name;
}

TEST(Stand, HealthyPopulationSpreadsAndStaysHealthy) {
  double sum = 0, squares = 0;
  constexpr int kUnits = 200;
  for (int seed = 0; seed < kUnits; ++seed) {
    const double level = steady_pressure_psi(draw_unit(static_cast<std::uint64_t>(seed)), 1.6);
    sum += level;
    squares += level * level;
  }
  const double mean = sum / kUnits, sd = std::sqrt(squares / kUnits - mean * mean);
  // 0.8 % of gain, 3 mA and 1.5 mA of shifts on about 350 psi/A: 1.5 psi; four standard errors of 200 units about it
  EXPECT_NEAR(mean, 120, 0.6);
  EXPECT_GT(sd, 0.9);
  EXPECT_LT(sd, 2.6);
}

TEST(Stand, LabelledValvesCarryEveryVerdictAndLotEveryKind) {
  const auto has = [](const auto& fleet, auto member, const std::string& value) {
    return std::any_of(fleet.begin(), fleet.end(), [&](const FleetValve& valve) { return valve.*member == value; });
  };
  for (const char* verdict : {"Good", "Malfunctioned", "Severe"})
    EXPECT_TRUE(has(labelled_valves(36, 1), &FleetValve::verdict, verdict));
  for (const char* kind : {"good", "sticking", "leaking", "slow", "drifting"})
    EXPECT_TRUE(has(returned_lot("L", 12, 1), &FleetValve::kind, kind));
}

}  // namespace
}  // namespace valvetriage::stand
