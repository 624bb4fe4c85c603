#include "core/model/magnetic_loop.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace valvetriage {
namespace {

IntervalSignal linear(const std::vector<double>& u) {
  IntervalSignal signal{u, u};
  for (std::size_t i = 0; i + 1 < u.size(); ++i) signal.end[i] = u[i + 1];
  return signal;
}

std::vector<double> triangle(double low, double high, int samples_per_way, int ways) {
  std::vector<double> u;
  for (int i = 0; i <= samples_per_way * ways; ++i) {
    const double x = static_cast<double>(i % (2 * samples_per_way)) / samples_per_way;
    u.push_back(low + (high - low) * (x < 1 ? x : 2 - x));
  }
  return u;
}

std::vector<double> run(const MagneticLoop& loop, const std::vector<double>& u) {
  const IntervalSignal signal = linear(u);
  return loop.apply(signal, loop_driver(signal, loop_gate(signal))).start;
}

TEST(MagneticLoop, OfNoWidthIsTheInput) {
  const auto u = triangle(1, 2, 100, 2);
  EXPECT_EQ(run({}, u), u);
}

TEST(MagneticLoop, IsAsWideAsItsWidthOnTheMajorLoop) {
  const auto u = triangle(1, 2.4, 1000, 3);
  const auto x = run({.width_a = 0.01}, u);
  // The second way down and the third up cross 1.7 A at samples 1500 and 2500.
  EXPECT_NEAR(x[1500] - x[2500], 0.01, 1e-9);
}

TEST(MagneticLoop, OfATenthOfTheReachIsTheSameLoopOfATenthOfTheCurrents) {
  const auto large = run({.width_a = 0.02, .memory = 0.3}, triangle(1, 2.4, 1000, 3));
  const auto small = run({.width_a = 0.002, .memory = 0.3, .reach = 0.1}, triangle(0.1, 0.24, 1000, 3));
  for (std::size_t i = 0; i < large.size(); ++i) ASSERT_NEAR(10 * small[i], large[i], 1e-9) << i;
}

TEST(MagneticLoop, DoesNotDependOnTheRate) {
  const auto slow = run({.width_a = 0.02}, triangle(1, 2, 1000, 2));
  const auto fast = run({.width_a = 0.02}, triangle(1, 2, 100, 2));
  for (std::size_t i = 0; i < fast.size(); ++i) EXPECT_NEAR(fast[i], slow[10 * i], 1e-9);
}

TEST(MagneticLoop, IsNotDemagnetisedByNoiseOnAHold) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::vector<double> u(4000, 1.6);
  for (std::size_t i = 0; i < 200; ++i) u[i] = 1.0 + 0.003 * static_cast<double>(i);
  Recording recording{.sample_period_s = 0.005};
  for (const double current : u) recording.input.values.push_back(current + 0.0005 * normal(random));
  recording.output.values = u;
  const IntervalSignal clean = noise_free_input(recording);
  const auto x = MagneticLoop{.width_a = 0.01}.apply(clean, loop_driver(clean, loop_gate(clean))).start;
  const double kept = (clean.start[300] - x[300]) - (clean.start[3999] - x[3999]);
  EXPECT_NEAR(kept, 0, 0.0005);  // under a tenth of the loop
}

TEST(MagneticLoop, KeepsAHeldCommandHeld) {
  IntervalSignal step{{1.0, 1.0, 1.6, 1.6}, {1.0, 1.0, 1.6, 1.6}};
  const IntervalSignal x = MagneticLoop{.width_a = 0.02}.apply(step, loop_driver(step, loop_gate(step)));
  EXPECT_EQ(x.start[1], x.end[1]);
  EXPECT_EQ(x.start[2], x.end[2]);
  EXPECT_NEAR(x.start[2], 1.6 - 0.01, 1e-12);
}

TEST(MagneticLoop, StartsFromItsMemory) {
  const std::vector<double> u(10, 1.5);
  EXPECT_NEAR(run({.width_a = 0.02, .memory = 1}, u)[0], 1.5 - 0.01, 1e-12);
  EXPECT_NEAR(run({.width_a = 0.02, .memory = -1}, u)[0], 1.5 + 0.01, 1e-12);
}

}  // namespace
}  // namespace valvetriage
