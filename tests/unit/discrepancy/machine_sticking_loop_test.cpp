#include "core/discrepancy/machine_sticking_loop.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "core/discrepancy/machine.h"
#include "tests/unit/discrepancy/machines.h"

namespace valvetriage {
namespace {

using namespace machines;

constexpr std::size_t kLoopSamples = 1200;
constexpr double kBreakaway = 2.5, kKinetic = 1.0;  // percent of the controller's output

/// A valve that holds until the force on it passes its breakaway.
struct Valve {
  double breakaway = 0, kinetic = 0, held = 0;

  double pass(double u) {
    if (breakaway <= 0) return u;
    if (std::abs(u - held) > breakaway) held = u - std::copysign(kinetic, u - held);
    return held;
  }
};

/// A fast process (flow) or an integrating one (level) under a PI controller, loads and noise.
struct Loop {
  Valve valve;
  bool integrates = false;
  Signal load = Signal(kLoopSamples, 0.0), set_point = Signal(kLoopSamples, 0.0);
  double noise = 0.1, rounding = 0;

  Recording run(std::uint64_t seed) {
    Noise random(seed);
    Signal u(kLoopSamples), y(kLoopSamples);
    double sum = 0, state = 0, before = 0;
    for (std::size_t t = 0; t < kLoopSamples; ++t) {
      y[t] = state + noise * random.normal();
      if (rounding > 0) y[t] = rounding * std::round(y[t] / rounding);
      const double error = set_point[t] - y[t];
      sum += (integrates ? 0.12 : 0.2) * error;
      u[t] = sum + (integrates ? 2.5 : 0.3) * error;
      const double flow = valve.pass(u[t]) + load[t];
      state += integrates ? 0.05 * before : 0.6 * (before - state);
      before = flow;
    }
    return recording(u, y, 1, 0, 0);
  }
};

Signal scaled(Signal x, double factor) {
  return each(std::move(x), [factor](double value) { return factor * value; });
}

/// A wave of ±1 of so many samples each period.
Signal square_wave(std::size_t period) {
  Signal x(kLoopSamples);
  for (std::size_t t = 0; t < x.size(); ++t) x[t] = t % period < period / 2 ? 1 : -1;
  return x;
}

Signal sine(double period) {
  Signal x(kLoopSamples);
  for (std::size_t t = 0; t < x.size(); ++t) x[t] = std::sin(2 * std::numbers::pi * static_cast<double>(t) / period);
  return x;
}

Signal walk(std::uint64_t seed) {
  Noise random(seed);
  Signal x(kLoopSamples);
  for (std::size_t t = 1; t < x.size(); ++t) x[t] = x[t - 1] + 0.2 * random.normal();
  return x;
}

TEST(StickingLoop, AFlowLoopThatCyclesByItsValveTellsTheBreakaway) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    Loop loop{.valve = {kBreakaway, kKinetic}, .load = scaled(coloured(kLoopSamples, 40, seed + 10), 1)};
    const auto found = sticking_loop(loop.run(seed));
    ASSERT_TRUE(found.has_value()) << "seed " << seed;
    EXPECT_NEAR(found->breakaway, kBreakaway, 0.2 * kBreakaway) << "seed " << seed;
    EXPECT_LE(found->breakaway_ci95[0], found->breakaway);
    EXPECT_GE(found->breakaway_ci95[1], found->breakaway);
    EXPECT_LT(found->p_value, 0.05);
  }
}

TEST(StickingLoop, AValveUnderASteppingSetPointIsFoundAsWell) {
  Loop loop{.valve = {kBreakaway, kKinetic}, .set_point = scaled(two_levels(kLoopSamples, 100, 5), 4)};
  EXPECT_TRUE(sticking_loop(loop.run(4)).has_value());
}

TEST(StickingLoop, ALevelLoopThatCyclesByItsValveIsFound) {
  Loop loop{.valve = {kBreakaway, kKinetic},
            .integrates = true,
            .load = scaled(coloured(kLoopSamples, 60, 6), 0.5),
            .noise = 0.02};
  EXPECT_TRUE(sticking_loop(loop.run(7)).has_value());
}

TEST(StickingLoop, AHealthyLoopHasNoStickingValveHoweverItIsDisturbed) {
  for (const bool integrates : {false, true}) {
    for (const std::uint64_t seed : {1, 2}) {
      const double noise = integrates ? 0.02 : 0.1;
      const auto expect_none = [&](Loop loop, const char* what) {
        loop.integrates = integrates;
        loop.noise = noise;
        EXPECT_FALSE(sticking_loop(loop.run(seed)).has_value())
            << what << (integrates ? " on a level" : " on a flow") << ", seed " << seed;
      };
      expect_none({.load = walk(seed + 20)}, "walk");
      expect_none({.load = scaled(two_levels(kLoopSamples, 60, seed + 30), 3)}, "load steps");
      expect_none({.load = scaled(square_wave(50), 2)}, "square wave");
      expect_none({.load = scaled(sine(37), 3)}, "sine");
      expect_none({.load = scaled(coloured(kLoopSamples, 20, seed + 40), 2), .rounding = 4 * noise}, "rounded reading");
      expect_none({.set_point = scaled(two_levels(kLoopSamples, 80, seed + 50), 4)}, "set-point steps");
    }
  }
}

TEST(StickingLoop, AStickingValveInALoopIsGivenAsFrictionWithWhatElseHoldsAnInputBack) {
  Loop loop{.valve = {kBreakaway, kKinetic}, .load = scaled(coloured(kLoopSamples, 40, 11), 1)};
  const Recording recording = loop.run(1);
  const auto diagnosis = diagnose_machine(std::span(&recording, 1), MachineOptions{});
  ASSERT_TRUE(diagnosis.has_value());
  const Discrepancy& d = diagnosis->discrepancy;
  EXPECT_EQ(d.conclusion, Conclusion::kAmbiguous);
  ASSERT_EQ(d.causes.size(), 1U);
  const auto& list = d.causes[0].alternatives;
  EXPECT_TRUE(d.causes[0].cause == "friction" || std::find(list.begin(), list.end(), "friction") != list.end());
  double sum = 0;
  for (const Candidate& candidate : d.candidates) sum += candidate.probability;
  EXPECT_NEAR(sum, 1, 1e-9);
}

}  // namespace
}  // namespace valvetriage
