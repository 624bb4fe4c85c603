#include "core/analysis/known_tests.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

namespace valvetriage {
namespace {

constexpr double kGaugeNoise_psi = 0.3;
constexpr double kTestPeriod_s = 0.005;
constexpr std::size_t kTestSamples = 800;
constexpr std::size_t kEdge = 250;

constexpr double kDigit_psi = 1e-4;

/// A step of the current, begun `later` samples later, and a reading that moves by its last digit.
Recording stepped(int later = 0) {
  Recording recording;
  recording.sample_period_s = kTestPeriod_s;
  for (std::size_t i = 0; i < kTestSamples; ++i) {
    recording.input.values.push_back(static_cast<double>(i) < static_cast<double>(kEdge) + later ? 1.0 : 1.6);
  }
  for (std::size_t i = 0; i < kTestSamples; ++i) recording.output.values.push_back(i % 2 == 0 ? 0 : kDigit_psi);
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

CommonResiduals common_of(const std::vector<OneStep>& valves) {
  std::vector<FollowedValve> followed;
  for (const OneStep& valve : valves) followed.push_back(valve.followed());
  return CommonResiduals(followed);
}

std::vector<KnownTest> known_of(const std::vector<OneStep>& valves) {
  return common_of(valves).of_all();
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

TEST(KnownTests, NoiseAloneIsNothingInCommon) {
  for (unsigned seed = 10; seed < 30; ++seed) {
    // A coefficient or two of eight hundred may stand out; all of them would be half a noise everywhere.
    const auto residual = known_of({{3 * seed, 0}, {3 * seed + 1, 0}, {3 * seed + 2, 0}}).at(0).residual;
    EXPECT_LT(std::sqrt(std::inner_product(residual.begin(), residual.end(), residual.begin(), 0.0) / kTestSamples),
              0.15 * kGaugeNoise_psi)
        << seed;
  }
}

TEST(KnownTests, OfOneValveIsExpectedWhatTheOthersLeave) {
  const CommonResiduals common = common_of({{1, 1}, {2, 1.1}, {3, 0.9}, {4, 1.6}});
  const auto at_edge = [](const std::vector<KnownTest>& tests) { return tests.at(0).residual[kEdge + 2]; };
  EXPECT_NEAR(at_edge(common.of_others(3)), bump(kEdge + 2), 0.6);
  EXPECT_GT(at_edge(common.of_others(0)), 1.1 * at_edge(common.of_others(3)));
}

TEST(KnownTests, SamplesThatAValveLostAreThoseOfTheOthers) {
  OneStep lossy(2, 1);
  lossy.recordings[0].valid.assign(kTestSamples, 1);
  for (std::size_t i = kEdge - 20; i < kEdge + 100; ++i) {
    lossy.recordings[0].valid[i] = 0;
    lossy.recordings[0].input.values[i] = 0;
    lossy.recordings[0].output.values[i] = 1e6;
  }
  const auto tests = known_of({{1, 1}, lossy, {3, 1}});
  ASSERT_EQ(tests.size(), 1u);
  for (const std::size_t i : {kEdge + 2, kEdge + 20, kEdge + 110}) EXPECT_NEAR(tests[0].residual[i], bump(i), 0.6) << i;
}

TEST(KnownTests, ATestThatAValveWasNotPutThroughIsNoneAndTheOthersStay) {
  OneStep twice(2, 1);
  Recording other = stepped();
  for (double& current : other.input.values) current = 2.6 - current;
  twice.recordings.push_back(other);
  twice.simulated.emplace_back(kTestSamples, 0.0);
  const auto tests = known_of({{1, 1}, twice, {3, 1}});
  ASSERT_EQ(tests.size(), 1u);
  EXPECT_TRUE(left_in_common(other, tests).empty());
  EXPECT_EQ(left_in_common(stepped(), tests).size(), kTestSamples);
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
    const auto left = all_left_in_common(begun, tests);
    ASSERT_TRUE(left) << later;
    const auto edge = static_cast<std::size_t>(static_cast<int>(kEdge) + later);
    EXPECT_NEAR((*left)[0][edge + 2], tests[0].residual[kEdge + 2], kDigit_psi) << later;
  }
  EXPECT_TRUE(left_in_common(stepped(kMostShift + 40), tests).empty());
}

TEST(KnownTests, ATestIsTheSameInputOnTheSameClock) {
  const auto tests = known_of({{1, 1}, {2, 1}, {3, 1}});
  const auto is_known = [&](double gain, double period_s) {
    Recording recording = stepped();
    for (double& current : recording.input.values) current = 1.3 + gain * (current - 1.3);
    recording.sample_period_s = period_s;
    return !left_in_common(recording, tests).empty();
  };
  EXPECT_TRUE(is_known(1.01, kTestPeriod_s));
  EXPECT_FALSE(is_known(1.03, kTestPeriod_s));
  EXPECT_TRUE(is_known(1, 1.0005 * kTestPeriod_s));
  EXPECT_FALSE(is_known(1, 1.002 * kTestPeriod_s));
  // One that is not known among several: no part of a session is compared with other valves than the rest.
  Recording unknown = stepped();
  for (double& current : unknown.input.values) current = 2.6 - current;
  EXPECT_FALSE(all_left_in_common(std::vector{stepped(), unknown}, tests));
  EXPECT_TRUE(all_left_in_common(std::vector{stepped(), stepped()}, tests));
  // An edge that falls between two samples.
  Recording between = stepped();
  between.input.values[kEdge] = 1.3;
  EXPECT_FALSE(left_in_common(between, tests).empty());
}

TEST(KnownTests, AnEdgeThatComesLateAloneIsAnotherTest) {
  const auto two_edges = [](std::size_t second) {
    Recording recording = stepped();
    for (std::size_t i = second; i < kTestSamples; ++i) recording.input.values[i] = 1.3;
    for (std::size_t i = 0; i < kTestSamples; ++i) recording.output.values[i] = static_cast<double>(i % 7);
    return recording;
  };
  const KnownTest test{kTestPeriod_s, two_edges(600).input.values, std::vector<double>(kTestSamples, 1.0)};
  EXPECT_FALSE(left_in_common(two_edges(601), {&test, 1}).empty());
  EXPECT_TRUE(left_in_common(two_edges(610), {&test, 1}).empty());
}

TEST(KnownTests, OfAReadingThatNeverMovesNothingIsTakenOff) {
  Recording frozen = stepped();
  frozen.output.values.assign(kTestSamples, 0);
  const KnownTest test{kTestPeriod_s, frozen.input.values, std::vector<double>(kTestSamples, 1.0)};
  EXPECT_EQ(left_in_common(frozen, {&test, 1}), std::vector<double>(kTestSamples, 0.0));
  frozen.output.values[5] = 2;
  EXPECT_EQ(left_in_common(frozen, {&test, 1})[5], 2);  // to its only digit
  frozen.valid.assign(kTestSamples, 0);
  EXPECT_EQ(left_in_common(frozen, {&test, 1}), std::vector<double>(kTestSamples, 0.0));
}

TEST(KnownTests, AHoldIsKnownThroughTheNoiseOfItsMeter) {
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 0.0009);
  const auto held = [&] {
    OneStep valve(static_cast<unsigned>(random()), 0);
    for (double& current : valve.recordings[0].input.values) current = 1.4 + noise(random);
    return valve;
  };
  const OneStep first = held();
  const auto tests = known_of({first, held(), held()});
  ASSERT_EQ(tests.size(), 1u);
  Recording elsewhere = first.recordings[0];
  for (double& current : elsewhere.input.values) current += 0.01;
  EXPECT_FALSE(left_in_common(held().recordings[0], tests).empty());
  EXPECT_TRUE(left_in_common(elsewhere, tests).empty());
}

TEST(KnownTests, WhatIsTakenOffIsPutBack) {
  std::vector<Recording> recordings{stepped()};
  const std::vector<double> common(kTestSamples, 0.5);
  take_off(common, recordings[0]);
  EXPECT_EQ(recordings[0].output.values[4], -0.5);
  std::vector<double> run(kTestSamples, 2.0);
  put_back(common, run);
  EXPECT_EQ(run[3], 2.5);
  put_back({}, run);
  EXPECT_EQ(run[3], 2.5);
}

}  // namespace
}  // namespace valvetriage
