#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/model/model.h"
#include "tests/unit/model/half_way.h"

namespace valvetriage {
namespace {

using Complex = std::complex<double>;

using test::kPeriod_s;

Recording steps() {
  Recording r;
  r.sample_period_s = kPeriod_s;
  r.input.values.assign(400, 1.2);
  std::fill(r.input.values.begin() + 100, r.input.values.end(), 1.4);
  r.output.values.assign(400, 0);
  r.segments = {{.kind = SegmentKind::kHold, .begin = 0, .end = 100, .level = 1.2},
                {.kind = SegmentKind::kStep, .begin = 100, .end = 400, .level = 1.4, .from_level = 1.2}};
  return r;
}

Model lag_model(double tau) {
  Model m;
  m.kind = "linear";
  m.dynamics = {.domain = Domain::kS, .poles = {-1 / tau}, .gain = 50 / tau};
  m.output_offset = 3;
  return m;
}

TEST(Simulate, StartsSteadyAtTheFirstInputAndHoldsStepCommands) {
  const double tau = 0.1;
  const auto y = simulate(lag_model(tau), steps(), {});
  ASSERT_TRUE(y);
  for (std::size_t i = 0; i <= 100; ++i) EXPECT_NEAR((*y)[i], 63, 1e-10);
  for (std::size_t i = 100; i < 400; ++i) {
    const double t = static_cast<double>(i - 100) * kPeriod_s;
    EXPECT_NEAR((*y)[i], 63 + 10 * (1 - std::exp(-t / tau)), 1e-10);
  }
}

TEST(Simulate, SendsTheInputThroughTheMapBehindTheDynamics) {
  Model m = lag_model(0.02);
  m.dynamics.gain /= 50;
  m.map = StaticMap{.input = {1.2, 1.4, 1.6}, .output = {3.1, 26, 120}};
  m.output_offset = 0;
  const auto y = simulate(m, steps(), {});
  EXPECT_NEAR(y->front(), 3.1, 1e-12);
  EXPECT_NEAR(y->back(), 26, 1e-9);
}

TEST(Simulate, AValveAnswersAStepAlikeAtWhateverRateItIsSampled) {
  // A spool of 235 rad/s turns within a sample of 200 Hz; the pressure behind it is that of a run eight times as fine.
  Model m;
  m.kind = "valve";
  m.dynamics = to_transfer_function({.delay_s = 0.0055, .natural_frequency_rad_s = 235, .damping_ratio = 0.86});
  m.map = StaticMap{.input = {1.0, 1.2, 1.4, 1.6, 1.8, 2.0}, .output = {1, 3.1, 26, 120, 160, 210}};
  m.volume = OrificeVolume{.time_constant_s = 0.07, .exponent = 0.55, .supply_psi = 300, .reference_psi = 105};
  constexpr std::size_t kFiner = 8;
  const auto answer = [&](std::size_t finer) {
    Recording r = steps();
    r.sample_period_s /= static_cast<double>(finer);
    r.input.values.assign(400 * finer, 1.2);
    std::fill(r.input.values.begin() + static_cast<std::ptrdiff_t>(100 * finer), r.input.values.end(), 1.6);
    r.output.values.assign(400 * finer, 0);
    r.segments = {
        {.kind = SegmentKind::kHold, .begin = 0, .end = 100 * finer, .level = 1.2},
        {.kind = SegmentKind::kStep, .begin = 100 * finer, .end = 400 * finer, .level = 1.6, .from_level = 1.2}};
    return simulate(m, r, {});
  };
  const auto coarse = answer(1), fine = answer(kFiner);
  ASSERT_TRUE(coarse && fine);
  double largest = 0;
  for (std::size_t i = 0; i < coarse->size(); ++i) {
    largest = std::max(largest, std::abs((*coarse)[i] - (*fine)[i * kFiner]));
  }
  EXPECT_LT(largest, 0.35);  // the noise of a stand; a straight line between samples errs by twice that
}

TEST(Simulate, TakesTheInitialStateFromTheFirstMeasuredOutputs) {
  // The same second-order system from a state that is not steady: its free response is found again from 20 samples.
  Model m = lag_model(0.1);
  m.dynamics.poles = {Complex(-8, 25), Complex(-8, -25)};
  m.dynamics.gain = 50 * (64 + 625);
  Recording r = steps();
  const auto steady = *simulate(m, r, {});
  for (std::size_t i = 0; i < steady.size(); ++i) {
    const double t = static_cast<double>(i) * kPeriod_s;
    r.output.values[i] = steady[i] + 5 * std::exp(-8 * t) * std::cos(25 * t + 0.7);
  }
  const auto y = simulate(m, r, {.kind = InitialState::Kind::kMeasured, .samples = 20});
  for (std::size_t i = 0; i < steady.size(); ++i) EXPECT_NEAR((*y)[i], r.output.values[i], 1e-9);
}

TEST(Simulate, LeavesInvalidSamplesOutOfTheInitialState) {
  const Model m = lag_model(0.1);
  Recording r = steps();
  r.output.values = *simulate(m, r, {});
  r.valid.assign(r.samples(), 1);
  r.valid[3] = 0;
  r.output.values[3] = 1e6;
  const auto y = simulate(m, r, {.kind = InitialState::Kind::kMeasured, .samples = 10});
  EXPECT_NEAR((*y)[0], 63, 1e-9);
}

TEST(Simulate, StaysSteadyWhereTooFewMeasuredSamplesAskForTheSmallestMove) {
  const Model m = lag_model(0.1);
  Recording r = steps();
  r.output.values = *simulate(m, r, {});
  const auto y = simulate(m, r, {.kind = InitialState::Kind::kMeasured, .samples = 0});
  EXPECT_EQ(*y, r.output.values);
}

TEST(Simulate, RefusesAnUnstableModelByItsPole) {
  Model m = lag_model(0.1);
  m.dynamics = {
      .domain = Domain::kZ, .sample_time_s = kPeriod_s, .poles = {Complex(1.0503, 0.2027), Complex(1.0503, -0.2027)}};
  const auto y = simulate(m, steps(), {});
  ASSERT_FALSE(y);
  EXPECT_EQ(y.error().code, "unstable");
  EXPECT_NE(y.error().message.find("1.0503 ± 0.2027j has modulus 1.0697"), std::string::npos) << y.error().message;
}

TEST(Simulate, RunsAnUnstableModelOverAFiniteHorizon) {
  Model m = lag_model(0.1);
  m.output_offset = 0;
  m.dynamics = {.domain = Domain::kZ, .sample_time_s = kPeriod_s, .poles = {1.01}, .gain = 1};
  const auto y = simulate(m, steps(), {}, Horizon::kFinite);
  ASSERT_TRUE(y);
  // From the equilibrium −100 · 1.2 the step of 0.2 grows as 0.2 (1.01ⁿ − 1) / 0.01.
  EXPECT_NEAR((*y)[399], -120 + 20 * (std::pow(1.01, 299) - 1), 1e-6);
}

TEST(Simulate, SaysWhenAFiniteHorizonWasTooLong) {
  Model m = lag_model(0.1);
  m.dynamics = {.domain = Domain::kZ, .sample_time_s = kPeriod_s, .poles = {1000.0}, .gain = 1};
  EXPECT_EQ(simulate(m, steps(), {}, Horizon::kFinite).error().code, "overflow");
}

TEST(Simulate, BringsADiscreteModelToAnotherSampleTime) {
  Model m = lag_model(0.1);
  const auto wanted = *simulate(m, steps(), {});
  m.dynamics = *discretise_zoh(m.dynamics, 0.02);
  const auto y = simulate(m, steps(), {});
  ASSERT_TRUE(y);
  for (std::size_t i = 0; i < wanted.size(); ++i) EXPECT_NEAR((*y)[i], wanted[i], 1e-9);
}

TEST(Simulate, RefusesASampleTimeThatADiscreteModelCannotBeBroughtTo) {
  Model m = lag_model(0.1);
  m.dynamics = {.domain = Domain::kZ, .sample_time_s = 0.02, .poles = {-0.3}, .gain = 1};
  const auto y = simulate(m, steps(), {});
  ASSERT_FALSE(y);
  EXPECT_EQ(y.error().code, "no_continuous_equivalent");
}

TEST(Simulate, ADelayLongerThanARecordingLeavesTheValveWhereItIs) {
  for (const double delay_s : {3.0, 1e6, 1e300}) {
    Model linear = lag_model(0.1);
    linear.dynamics.delay_s = delay_s;
    Model valve;
    valve.kind = "valve";
    valve.dynamics = to_transfer_function({.delay_s = delay_s, .natural_frequency_rad_s = 235, .damping_ratio = 0.86});
    valve.map = StaticMap{.input = {1.0, 2.0}, .output = {13, 113}};
    Model recursion = lag_model(0.1);
    recursion.dynamics = *discretise_zoh(lag_model(0.1).dynamics, kPeriod_s);
    recursion.dynamics.delay_s = delay_s;
    for (const auto& [m, rest] : {std::pair{linear, 63.0}, std::pair{valve, 33.0}, std::pair{recursion, 63.0}}) {
      const auto y = simulate(m, steps(), {});
      ASSERT_TRUE(y) << y.error().message;
      for (const double pressure : *y) ASSERT_NEAR(pressure, rest, 1e-6) << m.kind << ' ' << delay_s;
    }
  }
}

TEST(Simulate, RefusesAMachineThatWouldRunMoreSamplesThanAnyRecordingHas) {
  const double own_samples = 400 * kPeriod_s;  // times its rate
  const auto run_at = [&](double samples) {
    Model m;
    m.kind = "machine";
    m.machine = Machine{.sample_period_s = own_samples / samples,
                        .blocks = {{.law = MachineLaw::kAffine, .parameters = {2, 1}}}};
    return simulate(m, steps(), {});
  };
  const auto taken = run_at(0.999e7), refused = run_at(1.001e7);
  ASSERT_TRUE(taken) << taken.error().message;
  EXPECT_NEAR(taken->back(), 3.8, 1e-12);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, "too_large");
  EXPECT_FALSE(run_at(1e300));
}

}  // namespace
}  // namespace valvetriage
