#include "core/analysis/known_tests.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <random>

namespace valvetriage {
namespace {

constexpr double kGaugeNoise_psi = 0.3;
constexpr double kTestPeriod_s = 0.005;
constexpr std::size_t kTestSamples = 800;
constexpr std::size_t kEdge = 250;

/// A step of the current, begun `later` samples later.
Recording stepped(int later = 0) {
  Recording recording;
  recording.sample_period_s = kTestPeriod_s;
  for (std::size_t i = 0; i < kTestSamples; ++i) {
    recording.input.values.push_back(static_cast<double>(i) < static_cast<double>(kEdge) + later ? 1.0 : 1.6);
  }
  recording.output.values.assign(kTestSamples, 0);
  return recording;
}

/// What no simulation follows: psi, at sample i.
double bump(std::size_t i) {
  return i < kEdge ? 0 : 4 * std::exp(-static_cast<double>(i - kEdge) / 30);
}

/// One valve: what its simulation leaves of one step is `times` the bump, and noise.
struct OneStep {
  std::vector<Recording> recordings;
  std::vector<std::vector<double>> simulated;

  OneStep(unsigned seed, double times, int later = 0) : recordings{stepped(later)} {
    std::mt19937 random(seed);
    std::normal_distribution<double> noise(0, kGaugeNoise_psi);
    simulated.emplace_back(kTestSamples, 50.0);
    for (std::size_t i = 0; i < kTestSamples; ++i) {
      const auto at = static_cast<std::ptrdiff_t>(i) - later;
      recordings[0].output.values[i] = 50 + (at < 0 ? 0 : times * bump(static_cast<std::size_t>(at))) + noise(random);
    }
  }
  FollowedValve followed() const { return {recordings, simulated}; }
};

std::vector<KnownTest> known_of(const std::vector<OneStep>& valves) {
  std::vector<FollowedValve> followed;
  for (const OneStep& valve : valves) followed.push_back(valve.followed());
  return known_tests(followed);
}

double largest_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0,
                         [](double most, double value) { return std::max(most, std::abs(value)); });
}

TEST(KnownTests, WhatAllValvesLeaveIsCommonAndTheirNoiseIsNot) {
  const auto tests = known_of({{1, 1}, {2, 1.05}, {3, 0.95}, {4, 1}});
  ASSERT_EQ(tests.size(), 1u);
  ASSERT_EQ(tests[0].residual.size(), kTestSamples);
  double squares = 0;
  for (std::size_t i = 0; i < kTestSamples; ++i) {
    squares += std::pow(tests[0].residual[i] - bump(i), 2) / kTestSamples;
    if (i < kEdge - 50 || i > kEdge + 300) {
      EXPECT_LT(std::abs(tests[0].residual[i]), 0.25) << i;
    }
  }
  // The mean of four noises would be off by half of one, and would be so everywhere.
  EXPECT_LT(std::sqrt(squares), 0.4 * kGaugeNoise_psi);
}

TEST(KnownTests, WhatOneValveLeavesAloneIsNotCommon) {
  const auto tests = known_of({{1, 0}, {2, 0}, {3, 1}, {4, 0}});
  ASSERT_EQ(tests.size(), 1u);
  EXPECT_LT(largest_of(tests[0].residual), 0.5);
}

TEST(KnownTests, ValvesOfOtherTestsHaveNothingInCommon) {
  OneStep other(2, 1);
  for (double& current : other.recordings[0].input.values) current = 2.6 - current;
  EXPECT_TRUE(known_of({{1, 1}, other, {3, 1}}).empty());
  EXPECT_TRUE(known_of({{1, 1}}).empty());
}

TEST(KnownTests, ATestIsKnownAgainWhereverItsRecordingBegins) {
  const auto tests = known_of({{1, 1}, {2, 1, 3}, {3, 1, -9}, {4, 1}});
  ASSERT_EQ(tests.size(), 1u);
  EXPECT_NEAR(tests[0].residual[kEdge + 2], bump(kEdge + 2), 0.6);
  for (const int later : {-30, 0, 30}) {
    const std::vector<Recording> begun{stepped(later)};
    const auto left = left_in_common(begun, tests);
    ASSERT_TRUE(left) << later;
    const auto edge = static_cast<std::size_t>(static_cast<int>(kEdge) + later);
    EXPECT_EQ((*left)[0][edge + 2], tests[0].residual[kEdge + 2]) << later;
  }
  EXPECT_FALSE(left_in_common(std::vector{stepped(kMostShift + 30)}, tests));
}

TEST(KnownTests, ATestIsTheSameInputOnTheSameClock) {
  const auto tests = known_of({{1, 1}, {2, 1}, {3, 1}});
  const auto is_known = [&](double gain, double period_s) {
    Recording recording = stepped();
    for (double& current : recording.input.values) current = 1.3 + gain * (current - 1.3);
    recording.sample_period_s = period_s;
    return left_in_common(std::vector{recording}, tests).has_value();
  };
  EXPECT_TRUE(is_known(1.015, kTestPeriod_s));
  EXPECT_FALSE(is_known(1.025, kTestPeriod_s));
  EXPECT_TRUE(is_known(1, 1.0005 * kTestPeriod_s));
  EXPECT_FALSE(is_known(1, 1.002 * kTestPeriod_s));
  // One that is not known among several: no part of a session is compared with other valves than the rest.
  Recording unknown = stepped();
  for (double& current : unknown.input.values) current = 2.6 - current;
  EXPECT_FALSE(left_in_common(std::vector{stepped(), unknown}, tests));
}

TEST(KnownTests, WhatIsTakenOffIsPutBack) {
  std::vector<Recording> recordings{stepped()};
  const std::vector<std::vector<double>> common{std::vector<double>(kTestSamples, 0.5)};
  take_off(common, recordings);
  EXPECT_EQ(recordings[0].output.values[3], -0.5);
  std::vector<std::vector<double>> runs{std::vector<double>(kTestSamples, 2.0)};
  put_back(common, runs);
  EXPECT_EQ(runs[0][3], 2.5);
  put_back({}, runs);
  EXPECT_EQ(runs[0][3], 2.5);
}

}  // namespace
}  // namespace valvetriage
