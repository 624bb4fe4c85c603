#include "core/discrepancy/machine.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "core/discrepancy/machine_conclusion.h"
#include "core/discrepancy/machine_feedback.h"
#include "core/discrepancy/machine_linear.h"
#include "core/discrepancy/machine_report.h"
#include "core/discrepancy/machine_second_look.h"
#include "core/mechanisms/mechanism.h"
#include "core/recording/prepare.h"
#include "core/residual/fit_figures.h"
#include "tests/unit/discrepancy/machines.h"

namespace valvetriage {
namespace {

using namespace machines;

constexpr double kPeriod_s = 0.02;
constexpr std::size_t kSamples = 900;
constexpr double kNoise = 0.01;

MachineDiagnosis diagnosis_of(const Recording& recording) {
  auto diagnosis = diagnose_machine(std::span(&recording, 1), MachineOptions{});
  EXPECT_TRUE(diagnosis.has_value());
  return std::move(diagnosis.value());
}

double parameter(const NamedCause& cause, const std::string& name) {
  for (const auto& [key, estimate] : cause.parameters) {
    if (key == name) return estimate.value;
  }
  ADD_FAILURE() << cause.cause << " has no " << name;
  return 0;
}

/// The truth is named, or stands among what the data cannot tell apart; nothing else is named.
void expect_found(const MachineDiagnosis& diagnosis, const std::string& truth) {
  const Discrepancy& d = diagnosis.discrepancy;
  ASSERT_FALSE(d.causes.empty()) << "nothing found";
  bool found = false;
  for (const NamedCause& cause : d.causes) {
    const auto& list = cause.alternatives;
    found = found || cause.cause == truth || std::find(list.begin(), list.end(), truth) != list.end();
  }
  EXPECT_TRUE(found) << "found " << d.causes.front().cause;
  EXPECT_LT(d.gain.rmse_extended * 1.3, d.gain.rmse_baseline);
}

void expect_nothing(const Discrepancy& d) {
  EXPECT_EQ(d.conclusion, Conclusion::kNone);
  EXPECT_TRUE(d.causes.empty());
  double sum = 0;
  for (const Candidate& candidate : d.candidates) sum += candidate.probability;
  EXPECT_NEAR(sum, 1, 1e-9);
}

std::string name_of(const testing::TestParamInfo<Case>& info) {
  return info.param.name;
}

/// Never a name with confidence that is not the truth; nothing is added to a healthy machine.
class HealthyMachine : public testing::TestWithParam<Case> {};

TEST_P(HealthyMachine, IsGivenNoName) {
  const Discrepancy d = diagnosis_of(GetParam().record(1000)).discrepancy;
  EXPECT_NE(d.conclusion, Conclusion::kNamed);
  for (const NamedCause& cause : d.causes) EXPECT_LT(cause.probability, 0.95) << cause.cause;
  // A position held in a loop integrates its own noise twice: the linear search does not reach its floor, and doubts.
  if (GetParam().name != "servo_position") expect_nothing(d);
}

INSTANTIATE_TEST_SUITE_P(Battery, HealthyMachine, testing::ValuesIn(healthy_machines()), name_of);

class FaultyMachine : public testing::TestWithParam<Case> {};

TEST_P(FaultyMachine, IsNotGivenAnotherNameWithConfidence) {
  const Discrepancy d = diagnosis_of(GetParam().record(1000)).discrepancy;
  if (d.conclusion != Conclusion::kNamed) return;
  ASSERT_FALSE(d.causes.empty());
  std::vector<std::string> names;
  for (const NamedCause& cause : d.causes) names.push_back(cause.cause);
  std::sort(names.begin(), names.end());
  std::string all;
  for (const std::string& name : names) all += (all.empty() ? "" : "+") + name;
  EXPECT_EQ(all, GetParam().truth);
}

INSTANTIATE_TEST_SUITE_P(Battery, FaultyMachine, testing::ValuesIn(faulty_machines()), name_of);
INSTANTIATE_TEST_SUITE_P(Strange, FaultyMachine, testing::ValuesIn(strange_machines()), name_of);

TEST(Machine, ALinearOscillatorHasNothingWrong) {
  const auto u = random_command(kSamples, 25, 1);
  expect_nothing(diagnosis_of(recording(u, Oscillator{}.run(u, kPeriod_s), kPeriod_s, kNoise, 2)).discrepancy);
}

TEST(Machine, AsFewSamplesAsCanBeFittedAreGivenNoName) {
  for (const std::size_t samples : {40u, 45u, 49u, 60u}) {
    const auto u = random_command(samples, 8, 3);
    const Discrepancy d = diagnosis_of(recording(u, lag(u, 0.15, kPeriod_s), kPeriod_s, 0.03, samples)).discrepancy;
    EXPECT_NE(d.conclusion, Conclusion::kNamed) << samples;
  }
}

TEST(Machine, TwoLagsWithADelayHaveNothingWrong) {
  auto u = random_command(kSamples, 30, 3);
  auto y = lag(lag(u, 0.15, kPeriod_s), 0.06, kPeriod_s);
  std::rotate(y.begin(), y.end() - 4, y.end());
  std::fill(y.begin(), y.begin() + 4, y[4]);
  expect_nothing(diagnosis_of(recording(u, y, kPeriod_s, 0.03, 4)).discrepancy);
}

TEST(Machine, AnIntegratorInNoiseHasNothingWrong) {
  const auto u = multisine(kSamples, 8, 5);
  std::vector<double> y(u.size());
  for (std::size_t t = 1; t < y.size(); ++t) y[t] = y[t - 1] + kPeriod_s * u[t - 1];
  expect_nothing(diagnosis_of(recording(u, y, kPeriod_s, 0.01, 6)).discrepancy);
}

TEST(Machine, AMassThatOnlyDampingHoldsIsALinearMachineDownToItsNoise) {
  const auto u = random_command(1500, 25, 31);
  const Discrepancy d = diagnosis_of(recording(u, pushed(u, kPeriod_s, 2.5, 0), kPeriod_s, 0.003, 32)).discrepancy;
  expect_nothing(d);
  EXPECT_LT(d.gain.rmse_baseline, 1.2 * 0.003);
}

TEST(Machine, FrictionThatHoldsAMassBackIsNotTakenForADelay) {
  const auto u = random_command(1500, 25, 33);
  const auto diagnosis = diagnosis_of(recording(u, pushed(u, kPeriod_s, 2.5, 0.6), kPeriod_s, 0.003, 34));
  expect_found(diagnosis, "friction");
  ASSERT_FALSE(HasFatalFailure());
  EXPECT_LT(diagnosis.discrepancy.gain.rmse_extended, 1.5 * 0.003);
  EXPECT_NEAR(parameter(diagnosis.discrepancy.causes[0], "kinetic_A"), 0.6, 0.06);
}

TEST(Machine, ATankThatEmptiesByTheRootOfItsLevelIsFound) {
  const auto u = each(random_command(1200, 25, 35), [](double x) { return 2 + 0.7 * x; });
  Signal y(u.size());
  double level = 4;
  for (std::size_t t = 0; t < y.size(); ++t) {
    y[t] = level;
    for (int s = 0; s < 10; ++s) level += 0.1 * kPeriod_s * 3 * (u[t] - std::sqrt(std::max(level, 0.0)));
  }
  const auto diagnosis = diagnosis_of(recording(u, y, kPeriod_s, 0.02, 36));
  expect_found(diagnosis, "orifice_flow");
  ASSERT_FALSE(HasFatalFailure());
  EXPECT_NEAR(parameter(diagnosis.discrepancy.causes[0], "exponent"), 0.5, 0.05);
}

TEST(Machine, ALevelInProportionThatOverflowsIsASaturationAndNoOrifice) {
  const auto u = random_command(1500, 25, 45);
  Signal y(u.size());
  double level = 0;
  const double rim = 0.6;
  for (std::size_t t = 0; t < y.size(); ++t) {
    y[t] = level;
    for (int s = 0; s < 10; ++s) level = std::min(level + 0.1 * kPeriod_s * 3 * (u[t] - level), rim);
  }
  const auto diagnosis = diagnosis_of(recording(u, y, kPeriod_s, 0.005, 46));
  expect_found(diagnosis, "saturation");
  ASSERT_FALSE(HasFatalFailure());
  EXPECT_NEAR(parameter(diagnosis.discrepancy.causes[0], "level_psi"), rim, 0.01);
}

TEST(Machine, ATankBelowAnotherHasAnExponentOfItsOwn) {
  const auto u = each(random_command(1200, 20, 43), [](double x) { return 2.6 + 0.8 * x; });
  const auto diagnosis = diagnosis_of(recording(u, Tanks{.exponent_upper = 1}.run(u, 1.0), 1.0, 0.03, 44));
  expect_found(diagnosis, "orifice_flow");
  ASSERT_FALSE(HasFatalFailure());
  EXPECT_NEAR(parameter(diagnosis.discrepancy.causes[0], "exponent"), 0.5, 0.1);
  EXPECT_LT(diagnosis.discrepancy.gain.rmse_extended, 2 * 0.03);  // with one exponent for both tanks: 3.1
}

/// The same with its segments and its kind, as read from a file.
Recording prepared(const Recording& measured) {
  RawRecording raw;
  raw.name = measured.name;
  raw.time.values = measured.time_s;
  raw.input = measured.input;
  raw.output = measured.output;
  const auto prepared = prepare_recording(std::move(raw), ColumnMapping{.time = "t", .input = "u", .output = "y"});
  EXPECT_TRUE(prepared.has_value()) << prepared.error().message;
  return prepared.value();
}

TEST(Machine, ACommandOfTwoLevelsIsHeldHoweverShortItsPulses) {
  const auto u = two_levels(1000, 5, 37);
  const Recording measured =
      prepared(recording(u, lag(Oscillator{}.run(u, kPeriod_s), 0.2, kPeriod_s), kPeriod_s, kNoise, 38));
  EXPECT_FALSE(machine_data(std::span(&measured, 1), kNoise, 5000).interval_means);
}

/// Held levels and triangles from -2 to 2, so many values of them a sample.
std::vector<Signal> levels_and_triangles(std::size_t per_sample) {
  const std::size_t samples = kSamples * per_sample;
  Signal levels(samples), triangles(samples);
  Noise noise(51);
  double level = 0;
  for (std::size_t t = 0; t < samples; ++t) {
    if (t % (60 * per_sample) == 0) level = 4 * noise.uniform() - 2;
    levels[t] = level;
    const double phase = static_cast<double>(t % (300 * per_sample)) / static_cast<double>(300 * per_sample);
    triangles[t] = 4 * std::abs(2 * phase - 1) - 2;
  }
  return {levels, triangles};
}

Signal every(const Signal& values, std::size_t stride) {
  Signal kept;
  for (std::size_t t = 0; t < values.size(); t += stride) kept.push_back(values[t]);
  return kept;
}

/// A lag ahead of a stop, the input held for so many steps of the physics or moving on with each of them.
std::vector<Recording> stopped_lag(std::size_t steps_a_sample, double stop, double noise_rms) {
  std::vector<Recording> recordings;
  for (const Signal& u : levels_and_triangles(steps_a_sample)) {
    const Signal y = each(lag(u, 0.2, kPeriod_s / static_cast<double>(steps_a_sample)),
                          [stop](double x) { return std::min(x, stop); });
    recordings.push_back(prepared(
        recording(every(u, steps_a_sample), every(y, steps_a_sample), kPeriod_s, noise_rms, 52 + recordings.size())));
    recordings.back().name = std::to_string(recordings.size()) + ".csv";
  }
  return recordings;
}

TEST(Machine, ACommandThatIsHeldOrMovesOnBetweenSamplesLeavesNothingOfALagEitherWay) {
  for (const std::size_t steps_a_sample : {1, 20}) {
    const auto diagnosis = diagnose_machine(stopped_lag(steps_a_sample, 10, 1e-3), MachineOptions{});
    ASSERT_TRUE(diagnosis.has_value());
    expect_nothing(diagnosis->discrepancy);
    EXPECT_LT(diagnosis->discrepancy.gain.rmse_baseline, 1.3 * 1e-3) << steps_a_sample;  // the wrong way: 8e-3
  }
}

TEST(Machine, AStopIsNamedWhetherTheCommandIsHeldOrMovesOnBetweenSamples) {
  for (const std::size_t steps_a_sample : {1, 20}) {
    const auto diagnosis = diagnose_machine(stopped_lag(steps_a_sample, 1, 1e-3), MachineOptions{});
    ASSERT_TRUE(diagnosis.has_value());
    const Discrepancy& d = diagnosis->discrepancy;
    EXPECT_EQ(d.conclusion, Conclusion::kNamed) << steps_a_sample;
    ASSERT_EQ(d.causes.size(), 1U);
    EXPECT_EQ(d.causes[0].cause, "saturation");
    EXPECT_LT(d.gain.rmse_extended, 1.5e-3) << steps_a_sample;
  }
}

TEST(MachineData, WithoutALimitEverySampleOfALongRecordingIsTaken) {
  const auto u = random_command(12000, 5, 71);
  const Recording measured = recording(u, lag(u, 0.05, kPeriod_s), kPeriod_s, kNoise, 72);
  const MachineData data = machine_data(std::span(&measured, 1), 0, std::numeric_limits<std::size_t>::max());
  ASSERT_EQ(data.records.size(), 1U);
  EXPECT_EQ(data.records[0].input.size(), measured.samples());
}

TEST(MachineData, WholeRecordsKeepTheStrideThatTheSearchHad) {
  const auto u = multisine(30000, 8, 73);
  const Recording measured = recording(u, lag(u, 5, kPeriod_s), kPeriod_s, 1e-3, 74);
  const MachineData searched = machine_data(std::span(&measured, 1), 0.05, 2000);
  ASSERT_GT(searched.stride, 1U);
  const MachineData whole = whole_records(std::span(&measured, 1), searched);
  ASSERT_EQ(whole.records.size(), 1U);
  EXPECT_EQ(whole.period_s, searched.period_s);
  EXPECT_EQ(whole.records[0].input.size(), (measured.samples() + whole.stride - 1) / whole.stride);
}

TEST(MachineData, AWindowDoesNotStandWhereTheInputRests) {
  auto u = random_command(20000, 5, 75);
  std::fill(u.begin(), u.begin() + 2500, 0.0);
  const Recording measured = recording(u, lag(u, 0.05, kPeriod_s), kPeriod_s, kNoise, 76);
  const MachineData data = machine_data(std::span(&measured, 1), 0, 5000);
  ASSERT_TRUE(data.windows);
  for (const MachineRecord& record : data.records) {
    EXPECT_EQ(record.input.size(), 1250U);
    // A quarter of a window at most.
    EXPECT_GT(record.start_s, (2500 - 1250 / 4 - 1) * kPeriod_s);
  }
}

TEST(MachineData, ASecondLookGoesWhereMostIsLeftAndKeepsHalfOfTheFirst) {
  const auto u = random_command(4000, 5, 141);
  Signal y = lag(u, 0.05, kPeriod_s);
  for (std::size_t t = 2600; t < 2900; ++t) y[t] += 1;
  const std::vector<Recording> recordings{recording(u, y, kPeriod_s, kNoise, 142),
                                          recording(u, lag(u, 0.05, kPeriod_s), kPeriod_s, kNoise, 143)};
  const MachineData first = machine_data(recordings, 0, 1000);
  ASSERT_EQ(first.records.size(), 2U);
  const MachineData whole = whole_records(recordings, first);
  LinearMachine lags = linear_machine(1, std::vector{std::complex<double>(std::exp(-kPeriod_s / 0.05))}, 0, 1, whole);
  ASSERT_TRUE(solve_linear(whole, lags));
  const auto second = second_look(recordings, first, whole, lags.fit, 0.01);
  ASSERT_TRUE(second.has_value());
  ASSERT_EQ(second->records.size(), 4U);
  EXPECT_NEAR(static_cast<double>(second->samples()), static_cast<double>(first.samples()), 2);
  EXPECT_EQ(second->records[0].start_s, 0);
  EXPECT_NEAR(second->records[1].start_s, 2600 * kPeriod_s, 100 * kPeriod_s);
  // Nothing is left that noise does not leave: no second look.
  EXPECT_FALSE(second_look(recordings, first, whole, lags.fit, 1.0).has_value());
}

TEST(Machine, ALongRecordingIsExplainedFromEndToEnd) {
  const auto u = random_command(9000, 5, 77);
  const auto limited = each(lag(u, 0.06, kPeriod_s), [](double x) { return std::min(x, 0.4); });
  const Recording measured = recording(u, lag(limited, 0.05, kPeriod_s), kPeriod_s, kNoise, 78);
  const auto diagnosis = diagnosis_of(measured);
  expect_found(diagnosis, "saturation");
  ASSERT_FALSE(HasFatalFailure());
  // The law has its parameters from 9,000 samples: what is left is noise.
  EXPECT_LT(fit_figures(measured.output.values, diagnosis.extended[0], {}).rmse, 1.1 * kNoise);
}

/// Several recordings of one machine, of which the search sees a part.
MachineDiagnosis diagnosis_of_parts(const std::vector<Recording>& recordings, std::size_t most_samples) {
  auto diagnosis = diagnose_machine(recordings, MachineOptions{.most_samples = most_samples});
  EXPECT_TRUE(diagnosis.has_value());
  return std::move(diagnosis.value());
}

/// Small commands first, then large ones.
Signal rising_command(std::size_t samples, std::uint64_t seed) {
  Signal u = random_command(samples, 25, seed);
  for (std::size_t t = 0; t < samples / 2; ++t) u[t] *= 0.3;
  return u;
}

TEST(Machine, AStopThatOnlyTheLaterHalvesOfLongRecordingsComeToIsFound) {
  std::vector<Recording> recordings;
  for (const std::uint64_t seed : {101, 103, 105}) {
    const Signal u = rising_command(1600, seed);
    const Signal y = each(lag(u, 0.1, kPeriod_s), [](double x) { return std::min(x, 0.7); });
    recordings.push_back(recording(u, y, kPeriod_s, kNoise, seed + 1));
  }
  const auto diagnosis = diagnosis_of_parts(recordings, 1500);
  expect_found(diagnosis, "saturation");
  ASSERT_FALSE(HasFatalFailure());
  EXPECT_NEAR(parameter(diagnosis.discrepancy.causes.front(), "level_psi"), 0.7, 0.02);
}

TEST(Machine, ATimeConstantThatChangesWhereTheSearchDoesNotLookIsStructure) {
  std::vector<Recording> recordings;
  for (const std::uint64_t seed : {111, 113, 115}) {
    const Signal u = random_command(1600, 25, seed);
    const Signal before = lag(u, 0.15, kPeriod_s), after = lag(u, 0.5, kPeriod_s);
    Signal y = before;
    std::copy(after.begin() + 900, after.end(), y.begin() + 900);
    recordings.push_back(recording(u, y, kPeriod_s, kNoise, seed + 1));
  }
  EXPECT_EQ(diagnosis_of_parts(recordings, 1500).discrepancy.conclusion, Conclusion::kUnexplained);
}

TEST(Machine, AMapThatFoldsAtTheMiddleIsStructureAndNotNothing) {
  const auto u = random_command(1800, 25, 121);
  const auto y = Oscillator{}.run(each(u, [](double x) { return -x * x; }), kPeriod_s);
  const Discrepancy d = diagnosis_of(recording(u, y, kPeriod_s, kNoise, 122)).discrepancy;
  EXPECT_NE(d.conclusion, Conclusion::kNone);
}

TEST(Machine, ACurveThatNeverStopsIsNoCertainSaturationHoweverCloselyTwoRoundedStopsFollowIt) {
  const auto u = each(random_command(1800, 25, 123), [](double x) { return 0.5 * x; });
  const auto y = lag(each(u, [](double x) { return x - 0.3 * x * x * x; }), 0.15, kPeriod_s);
  const Discrepancy d = diagnosis_of(recording(u, y, kPeriod_s, 0.005, 124)).discrepancy;
  EXPECT_NE(d.conclusion, Conclusion::kNamed);
}

TEST(Machine, AnOutputThatGoesUpAndDownOnItsOwnIsNotNamed) {
  const auto u = two_levels(1000, 200, 125);
  Signal y(u.size());
  for (std::size_t t = 0; t < y.size(); ++t) y[t] = std::sin(5 * static_cast<double>(t) * kPeriod_s) > 0 ? 1 : -1;
  const Discrepancy d = diagnosis_of(recording(u, y, kPeriod_s, kNoise, 126)).discrepancy;
  EXPECT_NE(d.conclusion, Conclusion::kNamed);
}

TEST(Machine, ALinearMachineThatReachesTheNoiseOfAllRecordingsHasNothingWrongThoughNoneTellsTheOthers) {
  // Only the fast recording excites the second mode, and what is fitted to the others does not know of it.
  std::vector<Recording> recordings;
  for (const auto& u : {random_command(1200, 300, 127), random_command(1200, 250, 128), sweep(1200, 0.005, 10)}) {
    const auto slow = Oscillator{.omega = 12, .zeta = 0.1}.run(u, 0.005);
    const auto fast = Oscillator{.omega = 41, .zeta = 0.05}.run(u, 0.005);
    Signal y(u.size());
    for (std::size_t t = 0; t < y.size(); ++t) y[t] = slow[t] + 0.4 * fast[t];
    recordings.push_back(recording(u, y, 0.005, kNoise, 129));
  }
  expect_nothing(diagnosis_of_parts(recordings, 5000).discrepancy);
}

TEST(Machine, EveryCauseHasARowThatSaysWhyWhereItWasNotTried) {
  std::vector<Recording> recordings;
  for (const std::uint64_t seed : {131, 133}) {
    const auto u = random_command(600, 25, seed);
    recordings.push_back(recording(u, lag(u, 0.2, kPeriod_s), kPeriod_s, kNoise, seed + 1));
  }
  const Discrepancy d = diagnosis_of_parts(recordings, 5000).discrepancy;
  expect_nothing(d);
  for (const Mechanism* mechanism : all_mechanisms()) {
    const auto row = std::find_if(d.candidates.begin(), d.candidates.end(),
                                  [&](const Candidate& c) { return c.cause == mechanism->cause; });
    ASSERT_NE(row, d.candidates.end()) << mechanism->cause;
    if (std::isnan(row->rmse_heldout)) {
      EXPECT_FALSE(row->reason.empty()) << mechanism->cause;
    }
  }
}

TEST(MachineData, AReadingFarFromZeroHasItsOwnScale) {
  const auto u = random_command(900, 25, 135);
  const auto far = each(lag(u, 0.2, kPeriod_s), [](double x) { return 1e6 + 1e-2 * x; });
  const auto near = each(lag(u, 0.2, kPeriod_s), [](double x) { return 1e-2 * x; });
  const Recording at_far = recording(u, far, kPeriod_s, 0, 136), at_near = recording(u, near, kPeriod_s, 0, 136);
  const MachineData a = machine_data(std::span(&at_far, 1), 0, 5000), b = machine_data(std::span(&at_near, 1), 0, 5000);
  EXPECT_NEAR(a.output_scale / b.output_scale, 1, 1e-6);
}

TEST(Machine, AHardeningSpringIsFound) {
  const auto u = random_command(kSamples, 25, 7);
  const Oscillator spring{.force = [](double y, double) { return y + 0.3 * y * y * y; }};
  expect_found(diagnosis_of(recording(u, spring.run(u, kPeriod_s), kPeriod_s, kNoise, 8)), "stiffening_spring");
}

TEST(Machine, ASpringThatGivesWayOnceEverySampleIsSeenIsNotCalledStiffening) {
  // Longer than the windows of the search, through the mode alone: from 20 to 50 Hz.
  constexpr double kRate_hz = 750;
  constexpr std::size_t kLong = 8192;
  Signal u(kLong);
  for (std::size_t i = 0; i < kLong; ++i) {
    const double t = static_cast<double>(i) / kRate_hz;
    u[i] = 40 * std::sin(2 * std::numbers::pi * (20 * t + 15 * t * t * kRate_hz / kLong));
  }
  const auto y = mass_on_a_loop(u, 2e4, 1 / kRate_hz);
  for (const NamedCause& cause : diagnosis_of(recording(u, y, 1 / kRate_hz, 6e-7, 1)).discrepancy.causes) {
    if (cause.cause == "stiffening_spring") {
      EXPECT_GT(parameter(cause, "cubic_coefficient"), 0);
    }
  }
}

TEST(Machine, ALoopInTheRestoringForceIsNamedAndNothingBesideIt) {
  constexpr double kRate_hz = 750;
  constexpr std::size_t kPeriod = 4096;
  constexpr double kSensor = 8e-6;  // of a millimetre
  // The second of two periods, up to four times the mode.
  Signal u = multisine(kPeriod, 240, 21);
  for (double& force : u) force *= 50;
  u.insert(u.end(), u.begin(), u.end());
  const Signal y = mass_on_a_loop(u, 5e4, 1 / kRate_hz);
  const auto later = [](const Signal& x) { return Signal(x.begin() + kPeriod, x.end()); };
  const auto diagnosis = diagnosis_of(recording(later(u), later(y), 1 / kRate_hz, kSensor, 22));
  const Discrepancy& d = diagnosis.discrepancy;
  ASSERT_EQ(d.causes.size(), 1U);
  EXPECT_EQ(d.causes[0].cause, "hysteresis");
  EXPECT_EQ(d.conclusion, Conclusion::kNamed);
  EXPECT_LT(d.gain.rmse_extended, 1.3 * kSensor);
  EXPECT_GT(d.gain.rmse_baseline, 10 * kSensor);
}

TEST(Machine, CoulombFrictionInsideAMotionIsFound) {
  const auto u = random_command(kSamples, 25, 9);
  const Oscillator sticking{.coulomb = 0.25};
  expect_found(diagnosis_of(recording(u, sticking.run(u, kPeriod_s), kPeriod_s, kNoise, 10)), "friction");
}

TEST(Machine, TheSameSamplesHaveTheSameCauseInMicrosecondsAndInHours) {
  const auto u = random_command(kSamples, 25, 9);
  const auto y = Oscillator{.coulomb = 0.25}.run(u, kPeriod_s);
  const Discrepancy usual = diagnosis_of(recording(u, y, kPeriod_s, kNoise, 10)).discrepancy;
  ASSERT_EQ(usual.causes.size(), 1u);
  EXPECT_EQ(usual.causes.front().cause, "friction");
  for (const double unit : {1e-4, 1e5}) {
    const Discrepancy d = diagnosis_of(recording(u, y, unit * kPeriod_s, kNoise, 10)).discrepancy;
    ASSERT_EQ(d.causes.size(), 1u) << unit;
    EXPECT_EQ(d.causes.front().cause, "friction") << unit;
    EXPECT_NEAR(d.gain.rmse_extended, usual.gain.rmse_extended, 0.05 * usual.gain.rmse_extended) << unit;
  }
}

TEST(Machine, WhatASideChannelAddsIsFoundInWhateverUnitTheChannelIs) {
  const auto u = random_command(kSamples, 20, 31);
  const Signal room = coloured(kSamples, 100, 32);
  Recording recorded =
      recording(u, plus(lag(lag(u, 0.1, kPeriod_s), 0.03, kPeriod_s), room, 0.3), kPeriod_s, kNoise, 33);
  struct ChannelUnit {
    double mean = 0, deviation = 0;
  };
  for (const ChannelUnit unit : {ChannelUnit{24, 2}, {101325, 300}, {0, 1e-9}}) {
    recorded.side = {
        Channel{.name = "room", .values = each(room, [&](double x) { return unit.mean + unit.deviation * x; })}};
    const Discrepancy d = diagnosis_of(recorded).discrepancy;
    ASSERT_EQ(d.causes.size(), 1u) << unit.deviation;
    EXPECT_EQ(d.causes[0].cause, "side_input") << unit.deviation;
    EXPECT_NEAR(parameter(d.causes[0], "coefficient") * unit.deviation, 0.3, 0.01);
    EXPECT_LT(d.gain.rmse_extended, 1.5 * kNoise) << unit.deviation;
  }
  // One that stands still is not known from an offset.
  recorded.side = {Channel{.name = "room", .values = Signal(kSamples, 24)}};
  const std::vector<Candidate> candidates = diagnosis_of(recorded).discrepancy.candidates;
  const auto side = std::find_if(candidates.begin(), candidates.end(),
                                 [](const Candidate& candidate) { return candidate.cause == "side_input"; });
  ASSERT_NE(side, candidates.end());
  EXPECT_EQ(side->reason, "no side channel that moves was recorded");
}

TEST(Machine, AOneSidedLimitBetweenTwoLagsIsASaturation) {
  const auto u = random_command(kSamples, 20, 11);
  const auto limited = each(lag(u, 0.1, kPeriod_s), [](double x) { return std::min(x, 0.5); });
  const auto diagnosis = diagnosis_of(recording(u, lag(limited, 0.08, kPeriod_s), kPeriod_s, kNoise, 12));
  expect_found(diagnosis, "saturation");
  EXPECT_NEAR(parameter(diagnosis.discrepancy.causes[0], "level_psi"), 0.5, 0.05);
}

TEST(Machine, TheLevelsOfTwoRoundedStopsAreWhereTheReadingEnds) {
  const auto u = random_command(1500, 25, 81);
  const auto limited = each(lag(u, 0.1, kPeriod_s), [](double x) { return std::tanh(1.5 * x); });
  const auto diagnosis = diagnosis_of(recording(u, lag(limited, 0.08, kPeriod_s), kPeriod_s, kNoise, 82));
  for (const NamedCause& cause : diagnosis.discrepancy.causes) {
    for (const auto& [name, level] : cause.parameters) {
      EXPECT_NEAR(level.value, name == "level_psi" ? 1 : -1, 0.15) << name;
    }
  }
}

TEST(Machine, AReadingThatGrowsSlowerAndSlowerButNeverStopsIsNoCertainSaturation) {
  const auto u = random_command(2000, 40, 91);
  const auto y = each(lag(u, 0.5, kPeriod_s), [](double x) { return std::asinh(8 * x); });
  const Discrepancy d = diagnosis_of(recording(u, y, kPeriod_s, kNoise, 92)).discrepancy;
  EXPECT_NE(d.conclusion, Conclusion::kNamed);
}

TEST(Machine, ALagUnderATriangleOfOneRateHasNothingWrong) {
  Signal u(2000);
  for (std::size_t t = 0; t < u.size(); ++t) {
    const double phase = static_cast<double>(t % 500) / 500;
    u[t] = phase < 0.5 ? 4 * phase - 1 : 3 - 4 * phase;
  }
  Recording swept = recording(u, lag(lag(u, 0.4, kPeriod_s), 0.2, kPeriod_s), kPeriod_s, kNoise, 83);
  swept.test = TestKind::kTriangle;
  for (std::size_t begin = 0; begin < u.size(); begin += 250) {
    swept.segments.push_back({.kind = SegmentKind::kRamp,
                              .begin = begin,
                              .end = begin + 250,
                              .rate_per_s = (begin / 250 % 2 == 0 ? 1.0 : -1.0) * 8e-3 / kPeriod_s});
  }
  const Discrepancy d = diagnosis_of(swept).discrepancy;
  expect_nothing(d);
  EXPECT_LT(d.gain.rmse_baseline, 1.1 * kNoise);
}

TEST(Machine, ALongTriangleOfOneRateThatNeedsNoDynamicsIsAnsweredFromEndToEnd) {
  constexpr std::size_t kHalf = 1500;
  Signal u(6 * kHalf);
  for (std::size_t t = 0; t < u.size(); ++t) {
    const double share = static_cast<double>(t % kHalf) / kHalf;
    u[t] = t / kHalf % 2 == 0 ? 2 * share - 1 : 1 - 2 * share;
  }
  Recording swept = recording(u, each(u, [](double x) { return 3 * x + 1; }), kPeriod_s, kNoise, 151);
  for (std::size_t begin = 0; begin < u.size(); begin += kHalf) {
    swept.segments.push_back({.kind = SegmentKind::kRamp,
                              .begin = begin,
                              .end = begin + kHalf,
                              .rate_per_s = (begin / kHalf % 2 == 0 ? 2.0 : -2.0) / kHalf / kPeriod_s});
  }
  expect_nothing(diagnosis_of_parts({swept}, 2000).discrepancy);
}

TEST(Machine, AGainThatSwingsIsStructureAndAReadingThatWandersIsNot) {
  const auto u = random_command(2500, 30, 85);
  Signal swings = u, wander(u.size());
  Noise noise(86);
  for (std::size_t t = 0; t < u.size(); ++t) {
    swings[t] *= 1 + 0.35 * std::sin(2 * std::numbers::pi * 2.5 * static_cast<double>(t) / 2500);
    if (t > 0) wander[t] = wander[t - 1] + 0.012 * noise.normal();
  }
  const auto swinging = diagnosis_of(recording(u, lag(swings, 0.2, kPeriod_s), kPeriod_s, kNoise, 87)).discrepancy;
  EXPECT_EQ(swinging.conclusion, Conclusion::kUnexplained);
  const auto unknown = std::find_if(swinging.candidates.begin(), swinging.candidates.end(),
                                    [](const Candidate& c) { return c.cause == "unknown"; });
  ASSERT_NE(unknown, swinging.candidates.end());
  EXPECT_GT(unknown->probability, 0.5);
  const auto wandering = recording(u, plus(lag(u, 0.2, kPeriod_s), wander), kPeriod_s, kNoise, 88);
  EXPECT_EQ(diagnosis_of(wandering).discrepancy.conclusion, Conclusion::kNone);
}

TEST(Machine, AReadingThatJumpsOnItsOwnLeavesMoreThanNoise) {
  const auto u = random_command(2500, 25, 91);
  Noise jump(92);
  Signal level(u.size());
  for (std::size_t t = 1; t < u.size(); ++t) level[t] = t % 137 == 0 ? 0.3 * jump.normal() : level[t - 1];
  const auto jumping = recording(u, plus(lag(u, 0.2, kPeriod_s), level), kPeriod_s, kNoise, 93);
  EXPECT_EQ(diagnosis_of(jumping).discrepancy.conclusion, Conclusion::kUnexplained);
}

TEST(Machine, ADampingThatGrowsWithTheSpeedIsNoCertainHysteresis) {
  const auto u = random_command(2000, 40, 89);
  const Oscillator damped{
      .omega = 5, .zeta = 0.05, .force = [](double y, double v) { return y + 0.03 * v * std::abs(v); }};
  const Discrepancy d = diagnosis_of(recording(u, damped.run(u, kPeriod_s), kPeriod_s, kNoise, 90)).discrepancy;
  EXPECT_NE(d.conclusion, Conclusion::kNamed);
}

TEST(Machine, AReadingThatOnlyKnowsMagnitudesIsARectifiedSensor) {
  const auto u = random_command(kSamples, 25, 13);
  const auto y = each(lag(u, 0.2, kPeriod_s), [](double x) { return std::abs(x); });
  const auto diagnosis = diagnosis_of(recording(u, y, kPeriod_s, 0.005, 14));
  expect_found(diagnosis, "rectified_sensor");
}

TEST(Machine, MagnitudesOfAnOscillatorBehindALagAreExplainedDownToTheNoise) {
  const auto u = two_levels(1000, 5, 39);
  const auto y = each(lag(Oscillator{}.run(u, kPeriod_s), 0.25, kPeriod_s), [](double x) { return std::abs(x); });
  const auto diagnosis = diagnosis_of(recording(u, y, kPeriod_s, kNoise, 40));
  expect_found(diagnosis, "rectified_sensor");
  EXPECT_LT(diagnosis.discrepancy.gain.rmse_extended, 1.2 * kNoise);
}

TEST(Machine, ALagThatIsSlowerDownwardsIsFoundBehindADelay) {
  const auto u = random_command(kSamples, 25, 57);
  const auto diagnosis = diagnosis_of(recording(u, later(lag(u, 0.12, kPeriod_s, 0.2), 3), kPeriod_s, kNoise, 58));
  expect_found(diagnosis, "asymmetric_response");
  EXPECT_LT(diagnosis.discrepancy.gain.rmse_extended, 1.2 * kNoise);
}

TEST(Machine, AToneIsNotTheRingingOfALinearMachine) {
  const auto u = random_command(1500, 25, 59);
  auto y = Oscillator{.omega = 8, .zeta = 0.4}.run(u, kPeriod_s);
  for (std::size_t t = 0; t < y.size(); ++t) {
    y[t] += 0.15 * std::sin(2 * std::numbers::pi * 6.37 * kPeriod_s * static_cast<double>(t));
  }
  expect_found(diagnosis_of(recording(u, y, kPeriod_s, kNoise, 60)), "periodic_disturbance");
}

TEST(Machine, AReadingThatLosesGainAtAnInstantIsIntermittentFromThatInstantOn) {
  // The reading stands about 3, so that a linear machine takes most of the fall for a slow lag of its own.
  for (const double instant_s : {12.0, 18.0, 24.6}) {
    const auto u = random_command(1500, 20, 61);
    auto y = lag(u, 0.2, kPeriod_s);
    for (std::size_t t = 0; t < y.size(); ++t) {
      y[t] += 3;
      if (static_cast<double>(t) * kPeriod_s > instant_s) y[t] *= 0.85;
    }
    const auto diagnosis = diagnosis_of(recording(u, y, kPeriod_s, kNoise, 62));
    expect_found(diagnosis, "intermittent");
    EXPECT_LT(diagnosis.discrepancy.gain.rmse_extended, 1.2 * kNoise) << instant_s;
    EXPECT_NEAR(parameter(diagnosis.discrepancy.causes[0], "time_s"), instant_s, 2 * kPeriod_s);
    EXPECT_NEAR(parameter(diagnosis.discrepancy.causes[0], "gain_change"), -0.15, 0.01) << instant_s;
  }
}

TEST(Machine, LostMotionInFrontOfALagIsFoundWithItsWidth) {
  const auto u = random_command(kSamples, 20, 15);
  const auto diagnosis = diagnosis_of(recording(u, lag(play(u, 0.6), 0.1, kPeriod_s), kPeriod_s, kNoise, 16));
  expect_found(diagnosis, "backlash");
  if (diagnosis.discrepancy.causes[0].cause == "backlash") {
    EXPECT_NEAR(parameter(diagnosis.discrepancy.causes[0], "width_A"), 0.6, 0.06);
  }
}

TEST(Machine, TheExtendedModelRunsAsItWasShown) {
  const auto u = random_command(kSamples, 25, 17);
  const auto y =
      lag(each(u, [](double x) { return std::abs(x) < 0.5 ? 0 : x - std::copysign(0.5, x); }), 0.1, kPeriod_s);
  const Recording measured = recording(u, y, kPeriod_s, kNoise, 18);
  const auto diagnosis = diagnosis_of(measured);
  expect_found(diagnosis, "dead_band");
  const InitialState from_start{.kind = InitialState::Kind::kMeasured, .samples = measured.samples()};
  const auto run = simulate(diagnosis.extended_model, measured, from_start);
  ASSERT_TRUE(run.has_value()) << run.error().message;
  // Both start where the measurement says; the start's own noise dies out with the lag.
  EXPECT_LT(fit_figures(diagnosis.extended[0], *run, {}).rmse, 0.1 * kNoise);
}

TEST(Machine, GainDelayAndOffsetCannotBeNamedFromTheRecordingItself) {
  const auto u = random_command(300, 25, 19);
  const auto d = diagnosis_of(recording(u, lag(u, 0.1, kPeriod_s), kPeriod_s, kNoise, 20)).discrepancy;
  for (const char* cause : {"gain_loss", "transport_delay", "sensor_offset"}) {
    const auto row =
        std::find_if(d.candidates.begin(), d.candidates.end(), [&](const auto& c) { return c.cause == cause; });
    ASSERT_NE(row, d.candidates.end());
    EXPECT_EQ(row->status, CandidateStatus::kNotIdentifiable);
  }
}

TEST(Machine, ARegulatedLoopIsNotGivenAName) {
  Noise noise(21);
  std::vector<double> u(kSamples), y(kSamples);
  double state = 0, disturbance = 0;
  for (std::size_t t = 1; t < kSamples; ++t) {
    disturbance += 0.05 * noise.normal() - 0.02 * disturbance;
    u[t] = u[t - 1] - 0.4 * (y[t - 1]) - 0.8 * (t > 1 ? y[t - 1] - y[t - 2] : 0);
    state += 0.2 * (u[t] - state);
    y[t] = state + disturbance;
    u[t] = u[t - 1] - 0.4 * y[t] - 0.8 * (y[t] - y[t - 1]);
  }
  const auto d = diagnosis_of(recording(u, y, kPeriod_s, 1e-4, 22)).discrepancy;
  EXPECT_NE(d.conclusion, Conclusion::kNamed);
}

TEST(Machine, ARegulatedLoopIsNotExplainedByItsControllerRunBackwards) {
  const Recording loop = regulated(kSamples, kPeriod_s, 0, 0.3, 41);
  const auto d = diagnosis_of(loop).discrepancy;
  // The measurement's own noise cannot be known from the input before it.
  EXPECT_GT(d.gain.rmse_baseline, 0.7 * 0.005);
  EXPECT_GT(d.gain.noise_floor, 0.7 * 0.005);
}

/// A valve that sticks, a delay and a lag of 5 samples behind a PI controller that never comes to rest by it.
Recording limit_cycle(double breakaway, double kinetic, std::uint64_t seed) {
  constexpr std::size_t kCycleSamples = 2000, kDelay = 2;
  Noise noise(seed);
  Signal u(kCycleSamples), y(kCycleSamples), held(kCycleSamples);
  double sum = 0, state = 3, position = 0;
  for (std::size_t t = 0; t < kCycleSamples; ++t) {
    y[t] = state + 0.03 * noise.normal();
    sum -= 0.15 * y[t];
    u[t] = sum - y[t];
    const double strain = u[t] - position;
    if (std::abs(strain) > breakaway) position = u[t] - std::copysign(kinetic, strain);
    held[t] = position;
    state += 0.18 * ((t < kDelay ? 0 : held[t - kDelay]) - state);
  }
  return recording(u, y, kPeriod_s, 0, 0);
}

TEST(Machine, AValveThatKeepsALoopCyclingByItsFrictionIsFoundDownToTheNoise) {
  const auto d = diagnosis_of(limit_cycle(3, 2, 61)).discrepancy;
  ASSERT_FALSE(d.causes.empty());
  const auto& cause = d.causes.front();
  const auto& list = cause.alternatives;
  EXPECT_TRUE(cause.cause == "friction" || std::find(list.begin(), list.end(), "friction") != list.end());
  EXPECT_GT(d.gain.rmse_baseline, 1.5 * 0.03);
  EXPECT_LT(d.gain.rmse_extended, 1.1 * 0.03);
}

TEST(Machine, TheBlackBoxOfARegulatedLoopDoesNotKnowTheDisturbanceFromTheControllersAnswer) {
  Noise noise(63);
  const Signal load = coloured(2000, 33, 64);
  Signal u(2000), y(2000);
  double sum = 0, state = 0;
  for (std::size_t t = 0; t < u.size(); ++t) {
    y[t] = state + 0.5 * load[t] + 0.05 * noise.normal();
    sum -= 0.1 * y[t];
    u[t] = sum - 0.5 * y[t];
    state += 0.18 * ((t < 2 ? 0 : u[t - 2]) - state);
  }
  const auto d = diagnosis_of(recording(u, y, kPeriod_s, 0, 0)).discrepancy;
  EXPECT_EQ(d.conclusion, Conclusion::kNone);
  EXPECT_GT(d.gain.rmse_black_box, 0.9 * d.gain.rmse_baseline);
}

/// A lag of 10 samples behind a PI controller whose set-point steps now and then.
Recording loop_with_steps(std::uint64_t seed) {
  Noise noise(seed);
  Signal u(kSamples), y(kSamples);
  double sum = 0, state = 0, set_point = 0;
  for (std::size_t t = 0; t < kSamples; ++t) {
    if (t % 90 == 0) set_point = 10 * noise.uniform();
    y[t] = state + 0.01 * noise.normal();
    sum += 0.05 * (set_point - y[t]);
    u[t] = sum + 0.5 * (set_point - y[t]);
    state += 0.1 * (u[t] - state);
  }
  return recording(u, y, kPeriod_s, 0, 0);
}

TEST(LoopSigns, AnIntegratingControllerIsSeenBetweenTheStepsOfItsSetPoint) {
  const Recording loop = loop_with_steps(43);
  EXPECT_TRUE(loop_signs(std::span(&loop, 1)).integrating_controller);
}

TEST(LoopSigns, AMachineAloneShowsNoControllerHoweverDirectlyItAnswers) {
  const auto u = random_command(kSamples, 25, 45);
  const Signal direct = each(u, [](double x) { return 2 * x; }), slow = lag(u, 0.2, kPeriod_s);
  const auto smooth = multisine(kSamples, 8, 47);
  for (const Recording& alone : {recording(u, direct, kPeriod_s, 1e-3, 46), recording(u, slow, kPeriod_s, 1e-3, 46),
                                 recording(smooth, lag(smooth, 0.2, kPeriod_s), kPeriod_s, 1e-3, 48),
                                 recording(smooth, integral(smooth, kPeriod_s), kPeriod_s, 1e-3, 49)}) {
    EXPECT_FALSE(loop_signs(std::span(&alone, 1)).integrating_controller);
  }
}

/// An explanation with white residuals of these sizes on twelve held-out blocks.
MachineScore scored(std::vector<std::string> causes, const std::vector<double>& sizes, std::uint64_t seed) {
  MachineScore score{.causes = std::move(causes)};
  Noise noise(seed);
  for (const double size : sizes) {
    std::vector<double> gap(60);
    for (double& e : gap) e = size * noise.normal();
    score.gaps.push_back(std::move(gap));
    score.log_rms.push_back(std::log(size));
    score.mean += std::log(size) / static_cast<double>(sizes.size());
  }
  score.fit.squares = std::exp(2 * score.mean);
  score.fit.rows = 1;
  score.held_out = true;
  return score;
}

MachineSearch searched(const std::vector<MachineScore>& scores) {
  MachineSearch search;
  search.linear = scored({}, std::vector<double>(12, 1.0), 51);
  search.scores = scores;
  search.black_box_log_rms.assign(12, 0.0);
  search.black_box_rms = 1;
  return search;
}

/// With nothing to look at but the scores.
MachineVerdict concluded_from(const MachineSearch& search, double noise_rms, bool feedback) {
  const MachineData none;
  return conclude(search, none, {.data = none, .linear = search.linear.fit}, noise_rms, feedback);
}

TEST(MachineConclusion, APairIsNotMeasuredAgainstASingleThatDoesNotBeatTheLinearMachine) {
  // The single is far closer on half of the blocks, farther on the others: no law, yet close on the mean.
  std::vector<double> uneven;
  for (int i = 0; i < 12; ++i) uneven.push_back(i % 2 == 0 ? 0.2 : 1.3);
  const auto search = searched(
      {scored({"orifice_flow", "saturation"}, std::vector<double>(12, 0.48), 53), scored({"hysteresis"}, uneven, 52)});
  const MachineVerdict verdict = concluded_from(search, 0.3, false);
  ASSERT_NE(verdict.winner, nullptr);
  EXPECT_EQ(verdict.winner->name(), "orifice_flow+saturation");
}

TEST(MachineConclusion, ALawThatReachesTheNoiseIsNamedThoughTheLinearMachineIsNotFarAboveIt) {
  const auto search = searched({scored({"friction"}, std::vector<double>(12, 0.7), 54)});
  EXPECT_EQ(concluded_from(search, 0.7, false).conclusion, Conclusion::kNamed);
}

TEST(MachineConclusion, AMemoryThatLeavesMoreThanTwiceTheNoiseIsNotCertain) {
  const auto search = searched({scored({"hysteresis"}, std::vector<double>(12, 0.25), 61),
                                scored({"saturation"}, std::vector<double>(12, 0.9), 62)});
  EXPECT_EQ(concluded_from(search, 0.1, false).conclusion, Conclusion::kAmbiguous);
  EXPECT_EQ(concluded_from(search, 0.2, false).conclusion, Conclusion::kNamed);
}

TEST(MachineConclusion, AMemoryThatTakesNearlyAllThatTheLinearMachineLeavesIsCertainAboveTheNoise) {
  const auto search = searched({scored({"friction"}, std::vector<double>(12, 0.05), 73),
                                scored({"saturation"}, std::vector<double>(12, 0.9), 74)});
  EXPECT_EQ(concluded_from(search, 0.01, false).conclusion, Conclusion::kNamed);
}

TEST(MachineConclusion, WhatIsNowhereNearIsNoRivalAndWhatLooksAlikeIs) {
  // A stop that is as far off as the linear machine says nothing against friction; lost motion looks like it.
  const auto search = searched({scored({"friction"}, std::vector<double>(12, 0.25), 75),
                                scored({"saturation"}, std::vector<double>(12, 0.9), 76),
                                scored({"backlash"}, std::vector<double>(12, 0.95), 77)});
  const MachineVerdict verdict = concluded_from(search, 0.1, false);
  ASSERT_EQ(verdict.conclusion, Conclusion::kAmbiguous);
  EXPECT_EQ(verdict.alternatives.front(), std::vector<std::string>{"backlash"});
}

TEST(MachineConclusion, ACauseThatIsCertainAloneIsNamedWithoutADoubtfulSecond) {
  // Noise of 0.01: the drift takes half of what friction leaves, and may be what friction's law gets wrong.
  const auto search = searched({scored({"friction", "sensor_drift"}, std::vector<double>(12, 0.035), 78),
                                scored({"friction"}, std::vector<double>(12, 0.05), 79),
                                scored({"saturation"}, std::vector<double>(12, 0.9), 80)});
  const MachineVerdict verdict = concluded_from(search, 0.01, false);
  EXPECT_EQ(verdict.conclusion, Conclusion::kNamed);
  EXPECT_EQ(verdict.winner->name(), "friction");
}

TEST(MachineConclusion, NothingIsAddedToACauseThatLeavesNoMoreThanTheNoise) {
  const auto search = searched({scored({"hysteresis", "stiffening_spring"}, std::vector<double>(12, 0.07), 81),
                                scored({"stiffening_spring"}, std::vector<double>(12, 0.09), 82)});
  const MachineVerdict verdict = concluded_from(search, 0.1, false);
  EXPECT_EQ(verdict.conclusion, Conclusion::kNamed);
  EXPECT_EQ(verdict.winner->name(), "stiffening_spring");
}

/// One held-out law of the restoring force that is six times closer than the linear machine.
MachineSearch bent(MachineBlock block) {
  block.sections = {{.order = 2, .e = 0.1, .f = 0.1}};
  block.numerator = {1, 0, 0};
  MachineScore score = scored({"law"}, std::vector<double>(12, 0.16), 55);
  score.fit.machine.blocks = {std::move(block)};
  MachineSearch search = searched({std::move(score)});
  search.ground.input_low = search.ground.output_low = -3;
  search.ground.input_high = search.ground.output_high = 3;
  return search;
}

TEST(MachineConclusion, ASecondCauseThatLeavesMuchOfWhatTheFirstLeavesIsNotCertain) {
  // Noise of 0.07; of what the first law leaves above it, the second one leaves a fifth or two fifths.
  const auto concluded = [](double by_both) {
    const auto search = searched({scored({"orifice_flow"}, std::vector<double>(12, 0.2), 71),
                                  scored({"orifice_flow", "saturation"}, std::vector<double>(12, by_both), 72)});
    return concluded_from(search, 0.07, false).conclusion;
  };
  EXPECT_EQ(concluded(0.11), Conclusion::kNamed);
  EXPECT_NE(concluded(0.14), Conclusion::kNamed);
}

TEST(MachineConclusion, ASpringThatGivesWayIsStructureWithoutAName) {
  const auto search = bent({.law = MachineLaw::kSpring, .parameters = {0}, .feedback = {0.05, 0}});
  const MachineVerdict verdict = concluded_from(search, 0.1, false);
  EXPECT_EQ(verdict.conclusion, Conclusion::kUnexplained);
  EXPECT_EQ(verdict.winner, nullptr);
}

TEST(MachineConclusion, AStructureWithoutANameIsUnknownAndNotNothing) {
  const auto search = bent({.law = MachineLaw::kSpring, .parameters = {0}, .feedback = {0.05, 0}});
  const MachineVerdict verdict = concluded_from(search, 0.1, false);
  double most = 0;
  std::string cause;
  for (const Candidate& candidate : verdict.candidates) {
    if (candidate.probability > most) cause = candidate.cause;
    most = std::max(most, candidate.probability);
  }
  EXPECT_EQ(cause, "unknown");
}

TEST(MachineConclusion, ANamelessLawThatIsFarCloserThanANamedOneLeavesNoName) {
  auto search = bent({.law = MachineLaw::kSpring, .parameters = {0}, .feedback = {0.05, 0}});
  search.scores.push_back(scored({"saturation"}, std::vector<double>(12, 0.6), 56));
  EXPECT_EQ(concluded_from(search, 0.1, false).conclusion, Conclusion::kUnexplained);
  search.scores.back() = scored({"saturation"}, std::vector<double>(12, 0.1), 56);
  EXPECT_EQ(concluded_from(search, 0.1, false).conclusion, Conclusion::kNamed);
}

TEST(MachineConclusion, ALawFarCloserOnTheMeanButOnTooFewBlocksDoesNotLeaveNothing) {
  std::vector<double> uneven(12, 1.3);
  std::fill(uneven.begin(), uneven.begin() + 4, 0.01);
  const auto search = searched({scored({"saturation"}, uneven, 60)});
  const MachineVerdict verdict = concluded_from(search, 0.3, false);
  EXPECT_EQ(verdict.conclusion, Conclusion::kUnexplained);
  EXPECT_EQ(verdict.winner, nullptr);
}

TEST(MachineConclusion, AnEntryThatIsNotCertainHasARival) {
  const auto search = searched({scored({"saturation", "friction"}, std::vector<double>(12, 0.3), 57),
                                scored({"saturation", "backlash"}, std::vector<double>(12, 0.31), 58),
                                scored({"dead_band", "friction"}, std::vector<double>(12, 0.36), 59)});
  const MachineVerdict verdict = concluded_from(search, 0.29, false);
  ASSERT_EQ(verdict.conclusion, Conclusion::kAmbiguous);
  for (std::size_t i = 0; i < verdict.winner->causes.size(); ++i) {
    double probability = 0;
    for (const Candidate& candidate : verdict.candidates) {
      if (candidate.cause.find(verdict.winner->causes[i]) != std::string::npos) probability += candidate.probability;
    }
    EXPECT_TRUE(probability >= 0.95 || !verdict.alternatives[i].empty()) << verdict.winner->causes[i];
  }
}

TEST(MachineFit, FrictionOfAMassThatNeverRestsIsCertainByWhatIsFeltInMotion) {
  // A push that never turns: breakaway has no effect on the run, and no size of its own.
  MachineData data;
  data.period_s = 0.02;
  data.records.resize(1);
  MachineRecord& record = data.records[0];
  record.input = each(multisine(500, 8, 83), [](double u) { return 20 + u; });
  MachineFit fit;
  fit.machine.sample_period_s = data.period_s;
  fit.machine.blocks = {{.law = MachineLaw::kMotion, .parameters = {1, 0, 0, 0, 2.5, 1.5, 1.8, 0}}};
  for (const std::size_t index : {5, 6}) fit.free.push_back({.index = index, .lower = 0});
  fit.starts = {{0, 5}};
  record.output = run_machine(fit.machine, {}, fit.starts[0], record.input);
  Noise noise(84);
  for (std::size_t t = 0; t < record.output.size(); ++t) {
    record.output[t] += 1e-3 * noise.normal();
    record.valid.push_back(t);
  }
  EXPECT_TRUE(have_certain_sizes({"friction"}, data, fit));
  fit.machine.blocks[0].parameters[5] = 0;
  EXPECT_FALSE(have_certain_sizes({"friction"}, data, fit));
}

TEST(MachineTrials, ALawBetweenTwoFiltersMayHaveAnyModeAndAnyLagOnEitherSide) {
  MachineGround ground;
  ground.input_low = ground.output_low = -1;
  ground.input_high = ground.output_high = 1;
  ground.chosen_order = 6;
  MachineBlock block;
  block.sections = {{.order = 2, .e = 0.1, .f = 0.05},
                    {.order = 2, .e = 0.1, .f = 0.2},
                    {.order = 1, .f = 0.1},
                    {.order = 1, .f = 0.3}};
  block.numerator = {1, 0, 0, 0, 0, 0, 0};
  LinearMachine linear{.order = 6};
  linear.fit.machine.blocks = {block};
  linear.fit.machine.sample_period_s = 0.02;
  ground.linear = {linear};
  for (const MachineTrial& trial : sandwich_trials(ground)) {
    const auto even = std::count_if(trial.starts.begin(), trial.starts.end(), [](const MachineFit& start) {
      return order_of(start.machine.blocks.front().sections) == 3;
    });
    EXPECT_EQ(even, 4) << trial.causes.front();
  }
}

TEST(MachineFit, AModeSlowerThanTheRecordHasNoGainThatTheRecordShows) {
  MachineData data;
  data.records.resize(1);
  data.records[0].input.resize(1000);
  const std::vector<Section> slow_first{{.order = 1, .f = 1e-6}, {.order = 2, .e = 0.1, .f = 0.05}};
  const std::vector<Section> fast_first{{.order = 2, .e = 0.1, .f = 0.05}, {.order = 1, .f = 1e-6}};
  // Weights: level and difference of the last section, level (and difference) of the first, the input.
  EXPECT_EQ(gain_seen(data, slow_first, {5, 3, 7, 2}), 2);
  EXPECT_EQ(gain_seen(data, fast_first, {5, 7, 3, 2}), 9);
  EXPECT_EQ(gain_at_rest(fast_first, std::vector<double>{5, 7, 3, 2}), 14);
}

TEST(MachineConclusion, ALoopWhoseWayBackIsItsWayThereIsNoHysteresis) {
  const auto search = bent({.law = MachineLaw::kRestoringLoop, .parameters = {0.001, 0.98}, .feedback = {-0.5, 0}});
  const MachineVerdict verdict = concluded_from(search, 0.1, false);
  EXPECT_EQ(verdict.conclusion, Conclusion::kUnexplained);
  EXPECT_EQ(verdict.winner, nullptr);
}

TEST(MachineConclusion, WhatACloserLawWithoutItsEffectShowsIsUnknown) {
  // A loop whose way back is its way there is closer than friction: structure, but none that has a name.
  auto search = bent({.law = MachineLaw::kRestoringLoop, .parameters = {0.001, 0.98}, .feedback = {-0.5, 0}});
  search.scores.push_back(scored({"friction"}, std::vector<double>(12, 0.25), 85));
  search.scores.push_back(scored({"backlash"}, std::vector<double>(12, 0.7), 86));
  const MachineVerdict verdict = concluded_from(search, 0.1, false);
  ASSERT_EQ(verdict.conclusion, Conclusion::kAmbiguous);
  const auto probability = [&](const char* cause) {
    return std::find_if(verdict.candidates.begin(), verdict.candidates.end(),
                        [&](const Candidate& c) { return c.cause == cause; })
        ->probability;
  };
  EXPECT_GT(probability("unknown"), 0.2);
  EXPECT_LT(probability("law"), 0.02);
}

TEST(Machine, EqualRecordingsGiveEqualAnswers) {
  const auto u = random_command(400, 25, 23);
  const Recording measured = recording(u, lag(play(u, 0.6), 0.1, kPeriod_s), kPeriod_s, kNoise, 24);
  const auto first = diagnosis_of(measured), second = diagnosis_of(measured);
  EXPECT_EQ(first.discrepancy.gain.rmse_extended, second.discrepancy.gain.rmse_extended);
  EXPECT_EQ(first.extended, second.extended);
}

TEST(Machine, AnOutputThatNeverChangesIsRefused) {
  const Recording still = recording(random_command(100, 25, 25), std::vector<double>(100, 1.0), kPeriod_s, 0, 26);
  EXPECT_EQ(diagnose_machine(std::span(&still, 1), MachineOptions{}).error().code, "constant_output");
  EXPECT_EQ(diagnose_machine({}, MachineOptions{}).error().code, "no_recordings");
}

}  // namespace
}  // namespace valvetriage
