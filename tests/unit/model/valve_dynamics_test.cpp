#include "core/model/valve_dynamics.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/model/half_way.h"

namespace valvetriage {
namespace {

using test::kPeriod_s;

IntervalSignal unit_step(std::size_t n, std::size_t at) {
  IntervalSignal step{std::vector<double>(n, 0.0), std::vector<double>(n, 0.0)};
  for (std::size_t i = at; i < n; ++i) step.start[i] = step.end[i] = 1.0;
  return step;
}

/// Step response of two equal lags, 1 − (1 + ωt) e^(−ωt).
double critically_damped(double omega, double t) {
  return t <= 0 ? 0 : 1 - (1 + omega * t) * std::exp(-omega * t);
}

TEST(ValveDynamics, AStepAfterAFractionalDelayIsExactAtEverySample) {
  const ValveDynamics dynamics{.delay_s = 2.3 * kPeriod_s, .natural_frequency_rad_s = 30, .damping_ratio = 1};
  const SampledValveDynamics sampled(dynamics, kPeriod_s);
  std::vector<double> out(200);
  sampled.run(unit_step(200, 20), out);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double since = (static_cast<double>(i) - 20) * kPeriod_s - dynamics.delay_s;
    EXPECT_NEAR(out[i], critically_damped(30, since), 1e-10) << i;
  }
}

TEST(ValveDynamics, ARampIsExactBetweenItsSamples) {
  const ValveDynamics dynamics{.delay_s = 1.7 * kPeriod_s, .natural_frequency_rad_s = 40, .damping_ratio = 1};
  const SampledValveDynamics sampled(dynamics, kPeriod_s);
  IntervalSignal ramp;
  for (int i = 0; i < 400; ++i) {
    ramp.start.push_back(i * kPeriod_s);
    ramp.end.push_back((i + 1) * kPeriod_s);
  }
  std::vector<double> out(400);
  sampled.run(ramp, out);
  // Two equal lags follow a ramp at a distance of 2/ω once their transient is gone.
  const double t = 399 * kPeriod_s;
  EXPECT_NEAR(out[399], t - dynamics.delay_s - 2.0 / 40, 1e-9);
}

TEST(ValveDynamics, RestsAtItsFirstInput) {
  const SampledValveDynamics sampled(
      {.delay_s = 0.01, .natural_frequency_rad_s = 20, .damping_ratio = 0.4, .lag_s = {0.03}}, kPeriod_s);
  IntervalSignal constant{std::vector<double>(50, 7.5), std::vector<double>(50, 7.5)};
  std::vector<double> out(50);
  sampled.run(constant, out);
  for (const double y : out) EXPECT_NEAR(y, 7.5, 1e-10);
}

TEST(ValveDynamics, AgreesWithItsTransferFunctionAtRest) {
  const ValveDynamics dynamics{
      .delay_s = 0.01, .natural_frequency_rad_s = 20, .damping_ratio = 0.4, .lag_s = {0.03, 0.1}};
  const TransferFunction g = to_transfer_function(dynamics);
  EXPECT_NEAR(static_gain(g), 1.0, 1e-12);
  EXPECT_TRUE(is_stable(g));
  EXPECT_EQ(g.poles.size(), 4u);
}

}  // namespace
}  // namespace valvetriage
