#include <gtest/gtest.h>

#include <cmath>

#include "core/model/machine.h"

namespace valvetriage {
namespace {

struct Loop {
  double beta, delta;
};
constexpr Loop kLoops[] = {{0.8, -1.1}, {0.8, 0.5}, {2, 2}, {2, -2}, {0.5, 0}};
constexpr double kStarts[] = {-0.9, -0.2, 0, 0.3, 0.7};
constexpr double kMoves[] = {-1.3, -0.1, 0.02, 0.6};

/// h of dh/dx = 1 − beta sign(dx) h − delta |h| by `steps` of the mid-point rule.
double in_small_steps(double h, double move, const Loop& loop, int steps) {
  const double dx = move / steps;
  const auto slope = [&](double at) { return 1 - loop.beta * std::copysign(at, dx * at) - loop.delta * std::abs(at); };
  for (int i = 0; i < steps; ++i) h += dx * slope(h + 0.5 * dx * slope(h));
  return h;
}

TEST(RestoringLoop, AMoveIsWhatSmallStepsAddUpTo) {
  for (const Loop& loop : kLoops) {
    for (const double h : kStarts) {
      for (const double move : kMoves) {
        EXPECT_NEAR(loop_after(h, move, loop.beta, loop.delta), in_small_steps(h, move, loop, 20'000), 1e-6)
            << loop.beta << ' ' << loop.delta << ' ' << h << ' ' << move;
      }
    }
  }
}

TEST(RestoringLoop, TwoMovesOneWayAreOne) {
  for (const Loop& loop : kLoops) {
    for (const double h : kStarts) {
      for (const double move : kMoves) {
        const double half_way = loop_after(h, 0.4 * move, loop.beta, loop.delta);
        EXPECT_NEAR(loop_after(half_way, 0.6 * move, loop.beta, loop.delta), loop_after(h, move, loop.beta, loop.delta),
                    1e-12);
      }
    }
  }
}

TEST(RestoringLoop, AFarMoveEndsOnItsBranch) {
  EXPECT_NEAR(loop_after(-0.5, 1e3, 0.8, 0.5), 1 / (0.8 + 0.5), 1e-12);
  EXPECT_NEAR(loop_after(0.5, -1e3, 0.8, 0.5), -1 / (0.8 + 0.5), 1e-12);
}

TEST(RestoringLoop, WhatStandsStaysAsItIs) {
  for (const double h : kStarts) EXPECT_EQ(loop_after(h, 0, 0.8, -1.1), h);
}

}  // namespace
}  // namespace valvetriage
