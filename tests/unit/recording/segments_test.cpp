#include "core/recording/segments.h"

#include <gtest/gtest.h>

#include "tests/unit/recording/signals.h"

namespace valvetriage {
namespace {

constexpr double kPeriod = 0.005;

std::vector<Segment> segments_of(Signal u, unsigned seed) {
  add_noise(u, 0.0005, seed);
  return find_segments(u, kPeriod);
}

TEST(Segments, FindEveryStepAtTheFirstSampleOfItsNewLevel) {
  const std::vector<double> levels{1.0, 1.2, 1.0, 2.0, 1.0, 1.03};
  for (unsigned seed = 0; seed < 50; ++seed) {
    const auto segments = segments_of(steps_of(levels, 300), seed);
    ASSERT_EQ(segments.size(), levels.size()) << "seed " << seed;
    EXPECT_EQ(segments[0].kind, SegmentKind::kHold);
    for (std::size_t k = 0; k < levels.size(); ++k) {
      EXPECT_EQ(segments[k].begin, 300 * k);
      EXPECT_EQ(segments[k].end, 300 * (k + 1));
      // a mean over 300 samples of 0.5 mA noise: 0.03 mA, five of them
      EXPECT_NEAR(segments[k].level, levels[k], 1.5e-4);
      if (k == 0) continue;
      EXPECT_EQ(segments[k].kind, SegmentKind::kStep);
      EXPECT_NEAR(segments[k].from_level, levels[k - 1], 1.5e-4);
    }
    EXPECT_EQ(infer_test(segments), TestKind::kStep);
  }
}

TEST(Segments, FindAStepThatSlewsOverThreeSamplesWhereItPassesHalf) {
  Signal u = steps_of({1.0, 2.0}, 300);
  u[299] = 1.25;
  u[300] = 1.75;
  const auto segments = segments_of(u, 1);
  ASSERT_EQ(segments.size(), 2u);
  EXPECT_EQ(segments[1].begin, 300u);
  EXPECT_NEAR(segments[1].level, 2.0, 1.5e-4);
  EXPECT_NEAR(segments[0].level, 1.0, 1e-3);
}

TEST(Segments, TellAStaircaseFromSteps) {
  const auto segments = segments_of(steps_of({1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 1.8, 1.6, 1.4, 1.2, 1.0}, 200), 3);
  EXPECT_EQ(segments.size(), 11u);
  EXPECT_EQ(infer_test(segments), TestKind::kStaircase);
}

TEST(Segments, FollowATriangleThroughItsTurns) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    const auto segments = segments_of(triangle_of(4000, 2000), seed);
    ASSERT_EQ(segments.size(), 4u) << "seed " << seed;
    for (std::size_t k = 0; k < 4; ++k) {
      EXPECT_EQ(segments[k].kind, SegmentKind::kRamp);
      EXPECT_NEAR(static_cast<double>(segments[k].begin), 1000.0 * static_cast<double>(k), 10);
      EXPECT_NEAR(segments[k].rate_per_s, k % 2 == 0 ? 0.16 : -0.16, 0.005);
    }
    EXPECT_EQ(infer_test(segments), TestKind::kTriangle);
  }
}

TEST(Segments, TakeOscillationAndRandomInputsAsOneSweep) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    Signal white(2000, 1.6);
    add_noise(white, 0.1, seed + 100);
    Signal paused = swept_sine_of(4000);
    paused.insert(paused.begin(), 400, paused.front());
    for (const Signal& u : {swept_sine_of(4000), multisine_of(4000, seed), white, paused}) {
      const auto segments = segments_of(u, seed);
      EXPECT_EQ(infer_test(segments), TestKind::kSweep) << "seed " << seed;
      EXPECT_LE(segments.size(), 2u);
    }
  }
}

TEST(Segments, CoverTheInputWithoutHoles) {
  for (const Signal& u : {steps_of({1, 2, 1.5}, 100), triangle_of(3000, 700), swept_sine_of(3000), Signal(40, 1.0)}) {
    const auto segments = segments_of(u, 5);
    ASSERT_FALSE(segments.empty());
    EXPECT_EQ(segments.front().begin, 0u);
    EXPECT_EQ(segments.back().end, u.size());
    for (std::size_t k = 1; k < segments.size(); ++k) EXPECT_EQ(segments[k].begin, segments[k - 1].end);
  }
}

TEST(NoiseOf, EstimatesWhiteNoiseOnStepsAndRamps) {
  for (Signal u : {steps_of({1, 2, 1}, 2000), triangle_of(6000, 3000)}) {
    add_noise(u, 0.01, 9);
    EXPECT_NEAR(noise_of(u), 0.01, 0.0006);  // a median of 6000 absolute values is good to 3 %, two of them
  }
}

}  // namespace
}  // namespace valvetriage
