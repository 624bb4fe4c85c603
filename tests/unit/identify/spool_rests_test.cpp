#include "core/identify/spool_rests.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/unit/identify/valves.h"
#include "tests/unit/model/half_way.h"

namespace valvetriage {
namespace {

using test::kNoise_psi;

/// A spool that jumps by 50 mA every second from 1.1 A on, as its pressure shows it.
struct Stairs {
  test::MadeValve valve;
  std::vector<double> position;
  Recording recording;

  explicit Stairs(double noise_psi = kNoise_psi) {
    for (std::size_t i = 0; i < 3000; ++i) position.push_back(1.1 + 0.05 * static_cast<double>(i / 200));
    std::vector<double> steady;
    for (const double x : position) steady.push_back(valve.map(x));
    recording.sample_period_s = 0.005;
    std::vector<double>& y = recording.output.values;
    y.resize(steady.size());
    run_volume(valve.parameters.volume, recording.sample_period_s, steady.front(), test::straight_between(steady), y);
    std::mt19937 random(4);
    std::normal_distribution<double> normal;
    for (double& sample : y) sample += noise_psi * normal(random);
    recording.input.values.assign(y.size(), 1.1);
  }

  std::vector<double> rests() const {
    StaticMap map;
    for (double u = 1.0; u < 2.21; u += 0.005) {
      map.input.push_back(u);
      map.output.push_back(valve.map(u));
    }
    return spool_rests(recording, valve.parameters, map, 0, kNoise_psi);
  }
};

TEST(SpoolRests, AreWhereThePressureStandsStill) {
  const Stairs stairs;
  const std::vector<double> rests = stairs.rests();
  std::size_t known = 0;
  for (std::size_t i = 0; i < rests.size(); ++i) {
    const std::size_t into_rest = i % 200;
    // A window's length around a jump the spool may be anywhere.
    if (into_rest < 40 || into_rest > 190 || !std::isfinite(rests[i])) continue;
    EXPECT_NEAR(rests[i], stairs.position[i], 0.005) << i;
    ++known;
  }
  EXPECT_GT(known, rests.size() / 2);
}

TEST(SpoolRests, AreNotKnownWhereSamplesAreMissing) {
  Stairs stairs;
  stairs.recording.valid.assign(stairs.recording.samples(), true);
  for (std::size_t i = 1000; i < 1200; ++i) stairs.recording.valid[i] = false;
  const std::vector<double> rests = stairs.rests();
  for (std::size_t i = 1000; i < 1200; ++i) EXPECT_TRUE(std::isnan(rests[i])) << i;
  EXPECT_TRUE(std::isfinite(rests[1300]));
}

TEST(SpoolRests, AreNotKnownWhereTheMapIsFlat) {
  Stairs stairs;
  // The made valve's map is flat from 2.2 A on.
  for (double& y : stairs.recording.output.values) y = stairs.valve.map(2.2) - 0.01;
  for (const double rest : stairs.rests()) EXPECT_TRUE(std::isnan(rest));
}

TEST(SlipsBetweenRests, OnASlowRampTellBreakawayAndKineticForce) {
  // Rests on a ramp of 0.5 mA a sample: the spool sets off 100 mA behind its input and comes to rest 60 mA behind it.
  std::vector<double> input, rests;
  double rest = 0;
  for (std::size_t i = 0; i < 1000; ++i) {
    input.push_back(5e-4 * static_cast<double>(i));
    const bool slips = input.back() - rest > 0.1;
    if (slips) rest = input.back() - 0.06;
    rests.push_back(slips ? std::numeric_limits<double>::quiet_NaN() : rest);
  }
  const std::vector<Slip> up = slips_between(input, rests);
  ASSERT_GE(up.size(), 8u);
  for (const Slip& slip : up) {
    EXPECT_EQ(slip.direction, 1);
    EXPECT_NEAR(slip.before_a, 0.1, 0.001);
    EXPECT_NEAR(slip.after_a, 0.06, 0.001);
  }
  for (double& u : input) u = -u;
  for (double& x : rests) x = -x;
  const std::vector<Slip> down = slips_between(input, rests);
  ASSERT_EQ(down.size(), up.size());
  EXPECT_EQ(down.front().direction, -1);
  EXPECT_EQ(down.front().before_a, -up.front().before_a);
}

TEST(SlipsBetweenRests, AreNotWhatAStepOfTheInputMoves) {
  std::vector<double> input(200, 1.0), rests(200, 0.95);
  std::fill(input.begin() + 100, input.end(), 1.2);
  std::fill(rests.begin() + 100, rests.end(), 1.16);
  EXPECT_TRUE(slips_between(input, rests).empty());
}

TEST(SlipsBetweenRests, AreNotWhereOneRestWasTakenForTwo) {
  std::vector<double> input, rests;
  for (std::size_t i = 0; i < 200; ++i) {
    input.push_back(1.0 + 1e-4 * static_cast<double>(i));
    rests.push_back(i < 100 ? 0.95 : 0.945);
  }
  EXPECT_TRUE(slips_between(input, rests).empty());
}

}  // namespace
}  // namespace valvetriage
