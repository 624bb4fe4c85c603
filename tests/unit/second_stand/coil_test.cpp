#include <gtest/gtest.h>

#include "tests/second_stand/linear_parts.h"
#include "tests/second_stand/preisach.h"

namespace valvetriage::second_stand {
namespace {

double swept(Preisach& iron, double from_a, double to_a, int steps = 50) {
  double effective_a = 0;
  for (int i = 1; i <= steps; ++i) effective_a = iron.advance(from_a + (to_a - from_a) * i / steps);
  return effective_a;
}

TEST(Preisach, LoopClosesUnderSlowCycles) {
  Preisach iron(0.02);
  iron.advance(1.0);
  const double first = swept(iron, 1.0, 2.0);
  const double back = swept(iron, 2.0, 1.0);
  EXPECT_NEAR(swept(iron, 1.0, 2.0), first, 1e-12);
  EXPECT_NEAR(swept(iron, 2.0, 1.0), back, 1e-12);
}

TEST(Preisach, LoopIsAsWideAtMidRangeAsAskedFor) {
  Preisach iron(0.02);
  iron.advance(2.0);
  iron.advance(1.0);
  const double up = iron.advance(1.6);
  iron.advance(2.0);
  EXPECT_NEAR(iron.advance(1.6) - up, 0.02, 1e-9);
}

TEST(Preisach, LoopIsWidestAtMidRange) {
  Preisach iron(0.02);
  const auto width = [&](double at_a) {
    iron.advance(0.0);
    const double up = iron.advance(at_a);
    iron.advance(3.0);
    return iron.advance(at_a) - up;
  };
  EXPECT_GT(width(1.5), 1.2 * width(0.6));
  EXPECT_GT(width(1.5), 1.2 * width(2.4));
}

TEST(Preisach, PastIsWipedOutByALargerSwing) {
  Preisach one(0.02), other(0.02);
  for (const double visited : {1.7, 1.2, 1.5}) one.advance(visited);
  for (Preisach* iron : {&one, &other}) {
    iron->advance(0.0);
    iron->advance(2.5);
  }
  EXPECT_EQ(one.advance(1.6), other.advance(1.6));
}

TEST(Preisach, PathDoesNotHangOnItsSteps) {
  Preisach coarse(0.02), fine(0.02);
  for (const double turn : {2.0, 1.2, 1.7, 1.4}) coarse.advance(turn);
  double at = 0, last = 0;
  for (const double turn : {2.0, 1.2, 1.7, 1.4}) {
    last = swept(fine, at, turn, 37);
    at = turn;
  }
  EXPECT_NEAR(coarse.advance(1.4), last, 1e-12);
}

TEST(Preisach, EffectiveCurrentRisesWithTheCurrentForAnyWidth) {
  for (const double width_a : {0.0, 0.004, 0.03, 0.15}) {
    Preisach iron(width_a);
    iron.advance(2.2);
    double before = iron.advance(1.0);
    for (double current_a = 1.005; current_a < 2.2; current_a += 0.005) {
      const double now = iron.advance(current_a);
      EXPECT_GT(now, before) << width_a;
      before = now;
    }
  }
}

TEST(Oscillator, ManyShortStepsAreOneLong) {
  const Oscillator law(300, 0.7, 0.001);
  Oscillator::State many{0.2, 5};
  for (int i = 0; i < 10; ++i) many = law.advanced(many, 1.0);
  const Oscillator::State one = law.advanced({0.2, 5}, 1.0, 0.010);
  EXPECT_NEAR(many.position, one.position, 1e-12);
  EXPECT_NEAR(many.speed, one.speed, 1e-9);
}

}  // namespace
}  // namespace valvetriage::second_stand
