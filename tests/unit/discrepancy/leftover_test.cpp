#include "core/discrepancy/leftover.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/discrepancy/unnamed_direction.h"

namespace valvetriage {
namespace {

constexpr int kBlocks = 800;  // ln of their mean scatters by 0.05

double p_value(double slow, const LeftoverOnGoodValves& good, int valves) {
  return slower_than_good_valves(std::log1p(slow), kBlocks, good, valves).p_value;
}

TEST(Leftover, AnAmplitudeThreeTimesGoodValvesIsNotRareWhereTheirsDiffer) {
  // Eight that leave a tenth of the noise, give or take a twelfth: 8.7 times that is an amplitude of 2.9 times.
  const LeftoverOnGoodValves good{"at rest, high", 0.091, 0.073};
  EXPECT_GT(slower_than_good_valves(std::log1p(0.83), kBlocks, good, 8).statistic, 5);
  EXPECT_GT(p_value(0.83, good, 8), 2e-3);
  EXPECT_LT(p_value(8, good, 8), 1e-4);
  EXPECT_LT(p_value(0.83, good, 30), p_value(0.83, good, 8));
}

TEST(Leftover, WhatAllGoodValvesLeaveAlikeIsKnownBetter) {
  const LeftoverOnGoodValves alike{"moving, middle", 0.3, 0.03}, apart{"moving, middle", 0.3, 0.2};
  EXPECT_LT(p_value(2, alike, 8), 0.01 * p_value(2, apart, 8));
}

TEST(Leftover, AGroupAsSlowAsGoodValvesIsUsual) {
  const LeftoverOnGoodValves good{"moving, high", 0.2, 0.15};
  EXPECT_GT(p_value(0.2, good, 8), 0.3);
  EXPECT_GT(p_value(-0.1, good, 8), 0.5);
}

TEST(UnnamedDirection, WhatNoGoodValveShowsIsRareAndWhatNoiseShowsIsNot) {
  // Eight whose evidence is that of noise alone.
  const LeftoverOnGoodValves noise{"a delay that grows", 0.55, 0.5};
  EXPECT_GT(direction_p_value(4, noise, 8), 0.05);
  EXPECT_LT(direction_p_value(400, noise, 8), 1e-6);
  // Eight that show more of it: no good valve is surprising with as much again.
  const LeftoverOnGoodValves shown{"following for seconds", std::log1p(10), 1.0};
  EXPECT_GT(direction_p_value(40, shown, 8), 0.02);
  EXPECT_LT(direction_p_value(4, noise, 30), direction_p_value(4, noise, 8));
}

}  // namespace
}  // namespace valvetriage
