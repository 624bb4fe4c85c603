#include "core/model/spool_friction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "tests/unit/model/half_way.h"

namespace valvetriage {
namespace {

using test::kPeriod_s;
constexpr double kNowhere = std::numeric_limits<double>::quiet_NaN();
const ValveDynamics kSpool{.natural_frequency_rad_s = 300, .damping_ratio = 0.9};
const SpoolFriction kFriction{.breakaway_a = 0.1, .kinetic_a = 0.06, .stribeck_a_per_s = 0.2};

/// A rise of 0.1 A a second, held for half a second before it.
IntervalSignal slow_ramp(std::size_t samples) {
  IntervalSignal ramp;
  const auto at = [](std::size_t i) { return i < 100 ? 0.0 : 0.1 * kPeriod_s * static_cast<double>(i - 100); };
  for (std::size_t i = 0; i < samples; ++i) {
    ramp.start.push_back(at(i));
    ramp.end.push_back(at(i + 1));
  }
  return ramp;
}

std::vector<double> run(const SpoolFriction& friction, std::span<const double> rests = {}) {
  std::vector<double> position(1000);
  run_sliding_spool(kSpool, friction, kPeriod_s, slow_ramp(position.size()), 0, position, rests);
  return position;
}

/// How often the spool sets off from a rest, and where it rested before it did so the last time.
struct Slips {
  int count = 0;
  double last_from = 0;
};

Slips slips_of(const std::vector<double>& position) {
  Slips slips;
  for (std::size_t i = 2; i < position.size(); ++i) {
    const bool was_at_rest = position[i - 1] == position[i - 2];
    if (!was_at_rest || position[i] == position[i - 1]) continue;
    ++slips.count;
    slips.last_from = position[i - 1];
  }
  return slips;
}

TEST(SlidingSpool, OnASlowRampSlipsFromBreakawayToTheKineticForce) {
  const std::vector<double> position = run(kFriction);
  // 0.45 A of ramp: the first slip at 0.1 A, each later one 0.1 − 0.06 A farther.
  EXPECT_NEAR(slips_of(position).count, 1 + (0.45 - 0.1) / 0.04, 1.0);
  EXPECT_NEAR(position.back(), 0.45 - 0.08, 0.02 + 1e-9);
}

TEST(SlidingSpool, UnderAStepItIsTheFreeSpoolUnderAsMuchLessWheneverTheStepComes) {
  const std::size_t samples = 60, jump_at = 10;
  const double jump_a = 0.5, held_a = 0.08;
  const SpoolFriction friction{.breakaway_a = held_a, .kinetic_a = held_a, .stribeck_a_per_s = 0.2};
  IntervalSignal step;
  for (std::size_t i = 0; i < samples; ++i) step.start.push_back(i < jump_at ? 0 : jump_a);
  step.end = step.start;
  std::vector<double> position(samples);
  for (int part = 0; part <= 40; ++part) {
    ValveDynamics late = kSpool;
    late.delay_s = kPeriod_s * (1 + part / 20.0);
    run_sliding_spool(late, friction, kPeriod_s, step, 0, position);
    for (std::size_t i = 0; i < samples; ++i) {
      const double t = kPeriod_s * (static_cast<double>(i) - static_cast<double>(jump_at)) - late.delay_s;
      // Source: the step response of a pair of poles, Ogata, Modern Control Engineering, 5.3.
      const double wn = kSpool.natural_frequency_rad_s, zeta = kSpool.damping_ratio;
      const double wd = wn * std::sqrt(1 - zeta * zeta), decay = std::exp(-zeta * wn * t);
      const double free = t < 0 ? 0 : 1 - decay * (std::cos(wd * t) + zeta * wn / wd * std::sin(wd * t));
      EXPECT_NEAR(position[i], (jump_a - held_a) * std::min(free, 1.0), 0.003 * jump_a) << late.delay_s << ' ' << i;
    }
  }
}

TEST(SlidingSpool, AFrictionThatGrowsAlongTheWayHoldsFartherAtItsEnd) {
  SpoolFriction growing = kFriction;
  growing.growth = {.per_a = 1, .middle_a = 0.2};
  const std::vector<double> position = run(growing);
  // It first slips at 0.1 A (1 + (0 − 0.2)), and comes to rest where 0.06 A (1 + (x − 0.2)) hold it back.
  const auto first = std::find_if(position.begin(), position.end(), [](double x) { return x > 0; });
  EXPECT_NEAR(slow_ramp(1000).start[static_cast<std::size_t>(first - position.begin())], 0.08, 0.002);
  const double at = slips_of(position).last_from, held = 0.1 * (1 + at - 0.2), left = 0.06 * (1 + at - 0.2);
  EXPECT_GE(0.45 - position.back(), left - 0.003);
  EXPECT_LE(0.45 - position.back(), held + 0.003);
}

TEST(SlidingSpool, SeveralSideBySideAreEachAsAlone) {
  const ValveDynamics slow{.delay_s = 0.004, .natural_frequency_rad_s = 90, .damping_ratio = 0.7, .lag_s = {0.01}};
  const SpoolFriction weak{.breakaway_a = 0.02, .kinetic_a = 0.015, .stribeck_a_per_s = 0.1};
  const IntervalSignal ramp = slow_ramp(1000);
  std::vector<std::vector<double>> position;
  for (const std::size_t samples : {1000, 300, 0, 700, 1000, 50}) position.emplace_back(samples);
  std::vector<SlidingRun> runs;
  for (std::size_t k = 0; k < position.size(); ++k) {
    runs.push_back({k % 2 ? &slow : &kSpool,
                    k % 3 ? &weak : &kFriction,
                    kPeriod_s,
                    &ramp,
                    0.1 * static_cast<double>(k),
                    position[k],
                    {}});
  }
  run_sliding_spools(runs);
  for (const SlidingRun& beside : runs) {
    std::vector<double> alone(beside.position.size());
    run_sliding_spool(*beside.dynamics, *beside.friction, kPeriod_s, ramp, beside.offset, alone);
    EXPECT_EQ(std::vector<double>(beside.position.begin(), beside.position.end()), alone);
  }
}

TEST(SlidingSpool, RestsThatAreNotKnownChangeNothing) {
  EXPECT_EQ(run(kFriction, std::vector<double>(1000, kNowhere)), run(kFriction));
}

TEST(SlidingSpool, ItsOwnRestsChangeNothing) {
  const std::vector<double> free = run(kFriction);
  std::vector<double> rests(free.size(), kNowhere);
  for (std::size_t i = 1; i < free.size(); ++i) {
    if (free[i] == free[i - 1]) rests[i] = free[i];
  }
  EXPECT_EQ(run(kFriction, rests), free);
}

TEST(SlidingSpool, ASlipBeginsWhereTheSpoolIsKnownToRest) {
  const std::vector<double> free = run(kFriction);
  const Slips usual = slips_of(free);
  // From the middle on the spool is known to rest 3 mA higher than it came.
  std::vector<double> rests(free.size(), kNowhere);
  for (std::size_t i = 500; i < free.size(); ++i) {
    if (free[i] == free[i - 1]) rests[i] = free[i] + 0.003;
  }
  const std::vector<double> told = run(kFriction, rests);
  EXPECT_TRUE(std::equal(free.begin(), free.begin() + 500, told.begin()));
  // What is shown is where it came by itself, up to the slip: no jump by 3 mA while it stands.
  for (std::size_t i = 1; i < told.size(); ++i) {
    const double moved = std::abs(told[i] - told[i - 1]);
    EXPECT_FALSE(moved > 0 && std::abs(moved - 0.003) < 1e-6) << i;
  }
  EXPECT_LE(slips_of(told).count, usual.count);
}

TEST(SlidingSpool, ASpoolThatHoldsTooLongSlipsLateOnceAndNotForEver) {
  const std::vector<double> truth = run(kFriction);
  std::vector<double> rests(truth.size(), kNowhere);
  for (std::size_t i = 1; i < truth.size(); ++i) {
    if (truth[i] == truth[i - 1]) rests[i] = truth[i];
  }
  SpoolFriction holding = kFriction;
  holding.breakaway_a *= 1.05;
  const auto usual_error = [&](const std::vector<double>& position) {
    std::vector<double> errors;
    for (std::size_t i = 600; i < position.size(); ++i) errors.push_back(std::abs(position[i] - truth[i]));
    std::nth_element(errors.begin(), errors.begin() + 200, errors.end());
    return errors[200];
  };
  // Told where each slip really began, the error of one slip, 5 mA, does not add to that of the next.
  EXPECT_NEAR(usual_error(run(holding, rests)), 0.005, 0.002);
  EXPECT_GT(usual_error(run(holding)), 0.01);
  EXPECT_GE(slips_of(run(holding, rests)).count, slips_of(truth).count - 1);
}

}  // namespace
}  // namespace valvetriage
