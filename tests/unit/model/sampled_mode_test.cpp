#include "core/model/sampled_mode.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace valvetriage {
namespace {

constexpr double kHalf_s = 0.0025;
constexpr ValveDynamics kMode{.delay_s = 0.0068, .natural_frequency_rad_s = 40, .damping_ratio = 0.6, .lag_s = {}};

/// A step up, a rest, a step down, some of it straight and some held.
IntervalSignal up_and_down(double height) {
  IntervalSignal signal;
  for (int i = 0; i < 600; ++i) {
    const auto at = [&](int k) { return k < 100 ? 0 : k < 120 ? 0.02 * (k - 100) : k < 350 ? 1.0 : 0.2; };
    signal.start.push_back(5 + height * at(i));
    signal.end.push_back(5 + height * (i < 300 ? at(i + 1) : at(i)));
  }
  return signal;
}

std::vector<double> run(const SampledMode& mode, const IntervalSignal& input, const SampledMode::Start& start = {}) {
  std::vector<double> out(input.start.size());
  mode.run(input, start, out);
  return out;
}

TEST(SampledMode, IsTheDynamicsWhereItFallsAsItRises) {
  const IntervalSignal input = up_and_down(100);
  std::vector<double> known(input.start.size());
  SampledValveDynamics(kMode, kHalf_s).run(input, known);
  const std::vector<double> made = run({kMode, 1, kHalf_s}, input);
  for (std::size_t i = 0; i < made.size(); ++i) ASSERT_NEAR(made[i], known[i], 1e-10) << i;
}

TEST(SampledMode, FallsAsAModeThatIsSoManyTimesSlowerAndRisesAsItself) {
  // Overdamped: a step up only rises, a step down only falls.
  ValveDynamics lags = kMode;
  lags.damping_ratio = 1.5;
  const SampledMode asymmetric(lags, 1.8, kHalf_s);
  EXPECT_FALSE(asymmetric.is_symmetric());
  ValveDynamics slow = lags;
  slow.natural_frequency_rad_s /= 1.8;
  std::vector<double> rises(600), falls(600);
  for (const double way : {1.0, -1.0}) {
    const IntervalSignal step{std::vector<double>(600, way), std::vector<double>(600, way)};
    IntervalSignal from_rest = step;
    from_rest.start[0] = from_rest.end[0] = 0;
    SampledValveDynamics(way > 0 ? lags : slow, kHalf_s).run(from_rest, way > 0 ? rises : falls);
    const std::vector<double> made = run(asymmetric, from_rest);
    for (std::size_t i = 0; i < made.size(); ++i) ASSERT_NEAR(made[i], (way > 0 ? rises : falls)[i], 1e-10) << i;
  }
}

TEST(SampledMode, ASmallChangeGoesAlongItsWay) {
  const SampledMode mode(kMode, 1.4, kHalf_s);
  const IntervalSignal input = up_and_down(100);
  IntervalSignal change;
  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  for (std::size_t i = 0; i < input.start.size(); ++i) {
    change.start.push_back(std::sin(0.05 * static_cast<double>(i)));
    change.end.push_back(change.start.back() + 0.1 * normal(random));
  }
  const SampledMode::Start start{2, -3}, moved{0.5, 0.25};
  const auto displaced = [&](double by) {
    IntervalSignal there = input;
    for (std::size_t i = 0; i < there.start.size(); ++i) {
      there.start[i] += by * change.start[i];
      there.end[i] += by * change.end[i];
    }
    return run(mode, there, {start[0] + by * moved[0], start[1] + by * moved[1]});
  };
  std::vector<double> base(input.start.size()), along(input.start.size());
  const SampledMode::Way way = mode.run(input, start, base);
  mode.run_along(way, change, moved, along);
  const std::vector<double> above = displaced(1e-6), below = displaced(-1e-6);
  double largest = 0;
  for (std::size_t i = 0; i < base.size(); ++i) {
    ASSERT_NEAR((above[i] - below[i]) / 2e-6, along[i], 1e-4) << i;
    largest = std::max(largest, std::abs(along[i]));
  }
  EXPECT_GT(largest, 1);
}

}  // namespace
}  // namespace valvetriage
