#include "core/identify/coarse_rests.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "core/identify/valve_fit_problem.h"
#include "core/recording/segments.h"
#include "tests/unit/identify/valves.h"

namespace valvetriage {
namespace {

constexpr double kQuantum_a = 0.003;

double rounded(double current_a) {
  return kQuantum_a * std::round(current_a / kQuantum_a);
}

/// A hold at 1.4 A, then a sweep of 0.2 A about it; noise ahead of the rounding.
Recording logged(double noise_a, bool is_rounded) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  Recording recording{.name = "sweep.csv", .sample_period_s = 0.005};
  for (int i = 0; i < 4000; ++i) {
    const double t = i < 1000 ? 0 : 0.005 * (i - 1000);
    const double current_a = 1.4004 + 0.2 * std::sin(2 * t + 0.5 * t * t) + noise_a * normal(random);
    recording.input.values.push_back(is_rounded ? rounded(current_a) : current_a);
  }
  recording.output.values.assign(4000, 0.0);
  recording.segments = {{.kind = SegmentKind::kHold, .begin = 0, .end = 1000, .level = 1.4004},
                        {.kind = SegmentKind::kSweep, .begin = 1000, .end = 4000, .level = 1.4}};
  return recording;
}

TEST(CoarseRests, FindTheQuantumOfALogAndNoneInLevelsAndRampsOfATest) {
  const Recording coarse = logged(0, true), fine = logged(0.0005, false);
  EXPECT_NEAR(input_quantum({&coarse, 1}), kQuantum_a, 1e-9);
  EXPECT_EQ(input_quantum({&fine, 1}), 0);
  Recording triangle = fine;
  for (std::size_t i = 0; i < 4000; ++i)
    triangle.input.values[i] = 1 + 0.005 * std::abs(100 - static_cast<double>(i % 200));
  triangle.segments = find_segments(triangle.input.values, triangle.sample_period_s);
  EXPECT_EQ(input_quantum({&triangle, 1}), 0);
}

TEST(CoarseRests, AreAsUncertainAsTheNoiseAheadOfTheRoundingLeavesThem) {
  const auto hold_of = [](double noise_a) { return coarse_rests(logged(noise_a, true), kQuantum_a); };
  const std::vector<CoarseRest> undithered = hold_of(0);
  ASSERT_FALSE(undithered.empty());
  EXPECT_EQ(undithered.front().begin, 0u);
  EXPECT_EQ(undithered.front().end, 1000u);
  EXPECT_NEAR(undithered.front().variance, kQuantum_a * kQuantum_a / 12, 1e-9);
  EXPECT_TRUE(hold_of(kQuantum_a).empty());
  EXPECT_TRUE(coarse_rests(logged(0, true), 0).empty());
}

TEST(CoarseRests, TakeTheSameOffTheCostAndOffTheRowsThatExplainIt) {
  std::vector<Recording> recordings = test::session({}, 0.35, 1);
  recordings.push_back(logged(0.0005, false));
  ValveFitOptions options;
  options.knots = *map_knots(recordings);
  options.reference_psi = reference_pressure(recordings);
  const ValveFitProblem exact(recordings, options);
  for (Recording& recording : recordings) {
    for (double& current : recording.input.values) current = rounded(current);
  }
  ASSERT_NEAR(input_quantum(recordings), kQuantum_a, 1e-9);
  const ValveFitProblem problem(recordings, options);
  const Eigen::VectorXd v = problem.start_vector(test::MadeValve{}.parameters);
  double rows = 0, white = 0;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    rows += problem.rows(v, r).error.squaredNorm();
    const std::vector<double> simulated = problem.simulate(v, r);
    for (std::size_t i = 0; i < simulated.size(); ++i) {
      white += std::pow(recordings[r].output.values[i] - simulated[i], 2) * problem.inverse_variance(r);
    }
  }
  EXPECT_NEAR(problem.cost(v) - problem.penalty(v), rows, 1e-6 * rows);
  EXPECT_LT(rows, 0.99 * white);
}

}  // namespace
}  // namespace valvetriage
