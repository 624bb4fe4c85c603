#include "server/wire/model_c.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/mechanisms/simulate_extended.h"
#include "core/recording/segments.h"
#include "tests/unit/wire/c_program.h"

namespace valvetriage {
namespace {

constexpr double kPeriod_s = 0.005;
constexpr std::size_t kSamples = 10000;

Model valve() {
  Model model;
  model.kind = "valve";
  model.input_unit = "A";
  model.output_unit = "psi";
  model.loop = MagneticLoop{.width_a = 0.008};
  model.dynamics =
      to_transfer_function(ValveDynamics{.delay_s = 0.0123, .natural_frequency_rad_s = 180, .damping_ratio = 0.7});
  model.map = StaticMap{.input = {1.0, 1.2, 1.4, 1.6, 1.8, 2.0}, .output = {0.84, 3.1, 26, 120, 160, 210}};
  model.volume = OrificeVolume{.time_constant_s = 0.06, .exponent = 0.55, .supply_psi = 300, .reference_psi = 105};
  model.output_offset = 0.4;
  return model;
}

Model machine() {
  Model model;
  model.kind = "linear";
  model.dynamics = {
      .domain = Domain::kS, .poles = {{-8, 25}, {-8, -25}, {-60, 0}}, .gain = 100 * 689 * 60, .delay_s = 0.02};
  model.input_offset = 1.5;
  model.output_offset = 90;
  return model;
}

/// Steps, triangles and a sweep, without noise: 10,000 samples.
const Recording& motion() {
  static const Recording recording = [] {
    Recording r;
    r.sample_period_s = kPeriod_s;
    for (std::size_t i = 0; i < kSamples; ++i) {
      const double t = static_cast<double>(i) * kPeriod_s;
      constexpr double kLevels_a[] = {1.1, 1.6, 1.0, 1.8, 1.3, 2.0, 1.55, 1.7, 1.2, 1.9};
      const double triangle = 1 + std::abs(std::fmod(t, 6.0) / 3 - 1);
      const double sweep = 1.5 + 0.4 * std::sin(0.8 * t * (t - 40));
      r.input.values.push_back(t < 20 ? kLevels_a[static_cast<std::size_t>(t / 2)] : t < 40 ? triangle : sweep);
    }
    r.segments = find_segments(r.input.values, kPeriod_s);
    for (std::size_t i = 0; i < kSamples; ++i) r.output.values.push_back(0);
    Channel side{.name = "temperature_C", .quantity = "temperature", .unit = "", .file_unit = "", .values = {}};
    for (std::size_t i = 0; i < kSamples; ++i) side.values.push_back(i < kSamples / 2 ? -1 : 1);  // its mean is 0
    r.side.push_back(side);
    return r;
  }();
  return recording;
}

/// The same to the rounding of libraries and orders of summing, grown over 10,000 samples.
void expect_same(const Model& model) {
  const auto source = to_c(model, kPeriod_s);
  ASSERT_TRUE(source.has_value()) << source.error().message;
  const auto simulated = simulate_extended(model, motion(), {});
  ASSERT_TRUE(simulated.has_value()) << simulated.error().message;
  const std::vector<double> y = run_in_c(*source, motion());
  ASSERT_EQ(y.size(), kSamples);
  for (std::size_t i = 0; i < kSamples; ++i) ASSERT_NEAR(y[i], (*simulated)[i], 1e-6) << "at sample " << i;
}

Model with(Model model, const std::vector<MechanismUse>& uses) {
  model.mechanisms = uses;
  return model;
}

TEST(ModelC, AHealthyValveIsTheSimulation) {
  expect_same(valve());
}

TEST(ModelC, ALoopOfAnotherReachIsTheSimulation) {
  Model model = valve();
  model.loop->width_a = 0.05;
  model.loop->reach = 0.4;
  expect_same(model);
}

TEST(ModelC, AValveWhoseCommandIsHeldBetweenSamplesIsTheSimulation) {
  Model model = valve();
  model.input_between = InputBetween::kHeld;
  expect_same(model);
}

TEST(ModelC, AValveWhoseDynamicsFollowItsMapIsTheSimulation) {
  Model model = valve();
  model.dynamics = to_transfer_function(ValveDynamics{.delay_s = 0.0123, .natural_frequency_rad_s = 1600});
  model.mode = Mode{.natural_frequency_rad_s = 90, .damping_ratio = 0.9};
  expect_same(model);
  expect_same(with(model, {{"saturation", {120, -INFINITY, 1}, ""}, {"leakage", {0.1}, ""}}));
  expect_same(with(model, {{"extra_lag", {0.02, 1}, ""}}));
  expect_same(with(model, {{"friction", {0.02, 0.01, 0.5, 0}, ""}}));
  expect_same(with(model, {{"asymmetric_response", {1.7}, ""}}));
  expect_same(with(model, {{"backlash", {0.02, 0, 0}, ""}, {"transport_delay", {0.017}, ""}}));
  model.input_between = InputBetween::kHeld;
  expect_same(model);
  model.volume.reset();
  expect_same(model);
}

TEST(ModelC, ALinearMachineIsTheSimulation) {
  expect_same(machine());
  Model discrete;
  discrete.kind = "linear";
  discrete.dynamics = {.domain = Domain::kZ,
                       .sample_time_s = kPeriod_s,
                       .zeros = {-0.5},
                       .poles = {{0.9, 0.1}, {0.9, -0.1}},
                       .gain = 2,
                       .delay_s = 3 * kPeriod_s};
  expect_same(discrete);
}

TEST(ModelC, StickingAndLeakingAreInIt) {
  expect_same(
      with(valve(), {{"backlash", {0.03, -0.5, 0.2}, ""}, {"leakage", {0.1}, ""}, {"sensor_drift", {0.02}, ""}}));
}

TEST(ModelC, ASpoolThatSticksBehindItsCoilIsInIt) {
  Model sticking = with(valve(), {{"friction", {0.001, 0.0007, 0.3, 0}, ""}, {"friction", {0.03, 0.02, 0.3, 0.4}, ""}});
  expect_same(sticking);
  sticking.dynamics = to_transfer_function(
      ValveDynamics{.delay_s = 0.0123, .natural_frequency_rad_s = 180, .damping_ratio = 0.7, .lag_s = {0.004}});
  expect_same(sticking);
  sticking.mechanisms.clear();
  expect_same(sticking);
}

TEST(ModelC, AVolumeWithAirInItIsTheSimulation) {
  Model model = valve();
  model.volume->air_share = 0.05;
  expect_same(model);
}

TEST(ModelC, ALagAheadOfTheMapIsInItWithAndWithoutFriction) {
  expect_same(with(valve(), {{"extra_lag", {0.02, 1}, ""}}));
  expect_same(with(valve(), {{"extra_lag", {0.02, 1}, ""}, {"friction", {0.02, 0.01, 0.5, 0}, ""}}));
}

TEST(ModelC, EveryCauseOnTheInputAndInsideIsInIt) {
  expect_same(with(valve(), {{"backlash", {0.02, 0, 0}, ""},
                             {"hysteresis", {0.01, 0.1, 0.3}, ""},
                             {"transport_delay", {0.017}, ""},
                             {"orifice_flow", {-0.05}, ""},
                             {"asymmetric_response", {1.7}, ""},
                             {"saturation", {150, 5, 0}, ""}}));
}

TEST(ModelC, ASpoolThatComesToAStopIsInItWithAndWithoutALoss) {
  expect_same(with(valve(), {{"saturation", {120, -INFINITY, 1}, ""}}));
  expect_same(with(valve(), {{"saturation", {120, -INFINITY, 1}, ""}, {"leakage", {0.1}, ""}}));
}

TEST(ModelC, EveryCauseOnPositionAndMapIsInIt) {
  expect_same(with(valve(), {{"dead_band", {1.5, 0.03}, ""},
                             {"rate_limit", {3}, ""},
                             {"stiffening_spring", {3e-6}, ""},
                             {"gain_loss", {0.9}, ""},
                             {"static_curve", {0.1}, ""},
                             {"thermal_drift", {-0.1, 5, 0.6}, ""}}));
}

TEST(ModelC, EveryCauseOnTheReadingIsInIt) {
  expect_same(with(valve(), {{"extra_lag", {0.03, 0}, ""},
                             {"resonance", {12, 0.08}, ""},
                             {"self_oscillation", {8, 2, 120, 60, 0.25, 10, 0.3}, ""},
                             {"periodic_disturbance", {5, 1, 0.2}, ""},
                             {"sensor_offset", {2}, ""},
                             {"intermittent", {20, -0.1, 0}, ""},
                             {"side_input", {0.7, 20, 0}, "temperature_C"},
                             {"rectified_sensor", {}, ""}}));
}

TEST(ModelC, CausesOfALinearMachineAreInIt) {
  expect_same(with(machine(), {{"backlash", {0.05, 0.3, 0}, ""},
                               {"hysteresis", {0.02, 0.2, 0}, ""},
                               {"dead_band", {1.5, 0.1}, ""},
                               {"gain_loss", {0.9}, ""},
                               {"extra_lag", {0.02, 1}, ""}}));
}

TEST(ModelC, WhatCannotBeToldIsRefused) {
  EXPECT_EQ(to_c(with(machine(), {{"leakage", {0.1}, ""}}), kPeriod_s).error().code, "needs_volume");
  EXPECT_EQ(to_c(with(machine(), {{"static_curve", {0.1}, ""}}), kPeriod_s).error().code, "needs_range");
  EXPECT_EQ(to_c(with(valve(), {{"cosmic_rays", {}, ""}}), kPeriod_s).error().code, "unknown_cause");
  EXPECT_EQ(to_c(valve(), 0).error().code, "not_positive");
}

TEST(ModelC, NothingIsAllocated) {
  const std::string source = to_c(valve(), kPeriod_s).value();
  for (const char* word : {"malloc", "calloc", "stdlib", "free("})
    EXPECT_EQ(source.find(word), std::string::npos) << word;
}

}  // namespace
}  // namespace valvetriage
