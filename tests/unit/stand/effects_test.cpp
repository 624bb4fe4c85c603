#include <gtest/gtest.h>

#include <set>
#include <stdexcept>

#include "tests/stand/motion.h"
#include "tests/unit/stand/played.h"

namespace valvetriage::stand {
namespace {

bool shows_on_the_valve(const EffectInfo& info) {
  return info.effect != "rectified_sensor";
}

TEST(Effects, EveryCauseOfTheContractCanBeHiddenAndFourOthers) {
  const std::set<std::string> contract = {"friction",
                                          "backlash",
                                          "hysteresis",
                                          "dead_band",
                                          "saturation",
                                          "gain_loss",
                                          "static_curve",
                                          "rectified_sensor",
                                          "transport_delay",
                                          "extra_lag",
                                          "resonance",
                                          "rate_limit",
                                          "asymmetric_response",
                                          "leakage",
                                          "orifice_flow",
                                          "stiffening_spring",
                                          "self_oscillation",
                                          "periodic_disturbance",
                                          "thermal_drift",
                                          "sensor_offset",
                                          "sensor_drift",
                                          "intermittent",
                                          "side_input"};
  std::set<std::string> inside, outside;
  for (const EffectInfo& info : effect_table()) (info.in_vocabulary ? inside : outside).insert(info.effect);
  EXPECT_EQ(inside, contract);
  EXPECT_GE(outside.size(), 4u);
}

TEST(Effects, SizeZeroChangesNoBit) {
  const Session healthy = run_session(session_of({"step_up"}));
  for (const EffectInfo& info : effect_table()) {
    const Session spoiled = run_session(session_of({"step_up"}, {{info.effect, 0.0}}));
    EXPECT_EQ(healthy.recordings[0].pressure_psi, spoiled.recordings[0].pressure_psi) << info.effect;
  }
}

TEST(Effects, LeaveNoiseAndUnitAlone) {
  const Signature signature = signature_of(session_of({"step_up"}, {{"sensor_offset", 3.0}}));
  const double offset = signature.spoiled.truth[0].parameters[0].value;
  EXPECT_EQ(std::abs(offset), 3.0);
  for (std::size_t k = 0; k < 100; ++k)  // the offset and nothing else, to rounding
    EXPECT_NEAR(signature.spoiled.recordings[0].pressure_psi[k] - signature.healthy.recordings[0].pressure_psi[k],
                offset, 1e-9);
}

TEST(Effects, GrowWithTheirSize) {
  for (const EffectInfo& info : effect_table()) {
    if (!shows_on_the_valve(info)) continue;
    const auto at = [&](double size) { return signature_psi(session_of({"steps"}, {{info.effect, size}})); };
    const double small = at(info.malfunctioned_size), large = at(info.severe_size);
    EXPECT_GT(small, 0.1) << info.effect;
    EXPECT_GT(large, 1.2 * small) << info.effect;
  }
}

TEST(Effects, ShrinkWithTheirSize) {
  for (const EffectInfo& info : effect_table()) {
    if (!shows_on_the_valve(info)) continue;
    // The smallest size is barely seen beside the spread of good units, which is up to 1 % of the pressure: 2 psi.
    EXPECT_LT(signature_psi(session_of({"steps"}, {{info.effect, info.smallest}})), 2.0) << info.effect;
  }
}

TEST(Effects, PairIsNeitherOfTheTwo) {
  const double friction = signature_psi(session_of({"steps"}, {{"friction", 0.02}}));
  const double leakage = signature_psi(session_of({"steps"}, {{"leakage", 0.1}}));
  const double both = signature_psi(session_of({"steps"}, {{"friction", 0.02}, {"leakage", 0.1}}));
  EXPECT_GT(both, friction);
  EXPECT_GT(both, leakage);
}

TEST(Effects, UnknownNegativeDoubledAndImpossibleAreRefused) {
  EXPECT_THROW(run_session(session_of({"step_up"}, {{"rust", 1}})), std::invalid_argument);
  EXPECT_THROW(run_session(session_of({"step_up"}, {{"friction", -0.1}})), std::invalid_argument);
  EXPECT_THROW(run_session(session_of({"step_up"}, {{"friction", 0.01}, {"friction", 0.01}})), std::invalid_argument);
  EXPECT_THROW(run_session(session_of({"step_up"}, {{"gain_loss", 1.0}})), std::invalid_argument);
  EXPECT_THROW(run_session(session_of({"jump"})), std::invalid_argument);
}

/// What one effect, as faults on the nominal unit, does to the settled level of each step.
std::vector<double> level_changes(const Faults& faults) {
  std::vector<double> changes;
  for (const Command& command : commands_of("step"))
    changes.push_back(settled_psi(play(Unit{}, command, faults)) - settled_psi(play(Unit{}, command)));
  return changes;
}

TEST(Effects, FrictionHoldsTheSpoolBack) {
  Faults faults;
  faults.breakaway_a = 0.02;
  faults.kinetic_a = 0.014;
  EXPECT_LT(level_changes(faults)[2], -3);
}

TEST(Effects, LeakSettlesLowerAndMoreSoAtHighPressure) {
  Faults faults;
  faults.leak_fraction = 0.1;
  const auto changes = level_changes(faults);
  EXPECT_LT(changes[1], -0.5);
  EXPECT_LT(changes[2], 2 * changes[1]);
}

TEST(Effects, GainLossScalesEverySteadyLevel) {
  Faults faults;
  faults.pressure_ratio = 0.9;
  const auto commands = commands_of("step");
  for (std::size_t i = 1; i < 5; ++i)  // 1 %: the leak does not scale with the pressure
    EXPECT_NEAR(settled_psi(play(Unit{}, commands[i], faults)) / settled_psi(play(Unit{}, commands[i])), 0.9, 0.009);
}

TEST(Effects, SaturationStopsAtItsLevel) {
  Faults faults;
  faults.ceiling_psi = 150;
  const auto commands = commands_of("step");
  EXPECT_NEAR(settled_psi(play(Unit{}, commands[2], faults)), settled_psi(play(Unit{}, commands[2])), 0.01);
  for (const std::size_t i : {3u, 4u}) EXPECT_NEAR(settled_psi(play(Unit{}, commands[i], faults)), 150, 0.5);
}

TEST(Effects, StaticCurveAddsItsParabola) {
  Faults faults;
  faults.curvature = 0.1;
  const double q = 120.0 / 210;
  EXPECT_NEAR(level_changes(faults)[2], 0.1 * 210 * q * (1 - q), 0.2);
}

TEST(Effects, LagsDelayTheRiseAndKeepTheLevel) {
  const Command command = commands_of("step")[2];
  const auto healthy = play(Unit{}, command);
  Faults lag, late, slow;
  lag.extra_lag_s = 0.1;
  late.delay_s = 0.02;
  slow.slew_a_per_s = 2;
  for (const Faults& faults : {lag, late, slow}) {
    const auto spoiled = play(Unit{}, command, faults);
    EXPECT_LT(spoiled[310], healthy[310] - 5);
    EXPECT_NEAR(settled_psi(spoiled), settled_psi(healthy), 0.01);  // 4 s of 0.1 s: e^-40
  }
}

TEST(Effects, AsymmetricResponseFallsSlowerAndRisesAlike) {
  Faults faults;
  faults.fall_to_rise = 2;
  const Command command = commands_of("step")[4];
  const auto healthy = play(Unit{}, command), spoiled = play(Unit{}, command, faults);
  EXPECT_NEAR(spoiled[320], healthy[320], 0.05);
  EXPECT_GT(spoiled[1120], healthy[1120] + 10);
}

TEST(Effects, ResonanceRingsAtItsFrequency) {
  Faults faults;
  faults.mode_period_s = 0.1;
  faults.mode_damping = 0.05;
  const Command command = commands_of("step")[4];
  const auto spoiled = play(Unit{}, command, faults);
  const double level = settled_psi(spoiled);
  int crossings = 0;  // between 0.5 s and 1.5 s after the step: twice 10 Hz
  for (std::size_t k = 400; k < 600; ++k) crossings += (spoiled[k] - level) * (spoiled[k + 1] - level) < 0;
  EXPECT_NEAR(crossings, 20, 1);
}

TEST(Effects, HuntingLivesAtItsLevel) {
  Faults faults;
  faults.hunting_psi = 3;
  faults.hunting_hz = 6;
  faults.hunting_level_psi = 120;
  const auto commands = commands_of("step");
  const auto swing = [&](std::size_t i) {
    const auto pressure = play(Unit{}, commands[i], faults);
    return *std::max_element(pressure.begin() + 900, pressure.begin() + 1100) -
           *std::min_element(pressure.begin() + 900, pressure.begin() + 1100);
  };
  EXPECT_NEAR(swing(2), 6, 0.5);
  EXPECT_LT(swing(1), 0.3);
}

TEST(Effects, IntermittentContactIsInOneRecordingAndAfterItsInstant) {
  const Signature signature = signature_of(session_of({"steps", "sweep"}, {{"intermittent", 0.2}}));
  const HiddenEffect& hidden = signature.spoiled.truth[0];
  for (std::size_t i = 0; i < 2; ++i) {
    const StandRecording &healthy = signature.healthy.recordings[i], &spoiled = signature.spoiled.recordings[i];
    for (std::size_t k = 0; k < healthy.time_s.size(); ++k) {
      const bool after = healthy.name == hidden.recording && healthy.time_s[k] >= hidden.parameters[0].value;
      EXPECT_NEAR(spoiled.clean_psi[k], (after ? 0.8 : 1.0) * healthy.clean_psi[k], 1e-9 * (1 + healthy.clean_psi[k]));
    }
  }
}

TEST(Effects, WarmingCoilLosesItsGainWithinAFewTimeConstants) {
  Faults faults;
  faults.warming_gain_change = -0.1;
  faults.warming_time_constant_s = 1;
  const Command command = commands_of("sweep")[0];  // around 1.6 A, where the heating is the mean one
  const auto healthy = play(Unit{}, command), spoiled = play(Unit{}, command, faults);
  EXPECT_NEAR(spoiled[0], healthy[0], 0.01);
  double ratio = 0;
  for (std::size_t k = 3000; k < 4000; ++k) ratio += spoiled[k] / healthy[k] / 1000;
  EXPECT_NEAR(ratio, 0.9, 0.01);
}

TEST(Effects, FastClockOfThePressureShowsItEarly) {
  Faults faults;
  faults.clock_error = 0.01;
  const Command command = commands_of("step")[2];
  const auto healthy = play(Unit{}, command), spoiled = play(Unit{}, command, faults);
  EXPECT_GT(spoiled[305], healthy[305] + 10);  // 1 % of 1.5 s
}

}  // namespace
}  // namespace valvetriage::stand
