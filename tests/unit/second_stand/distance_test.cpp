#include <gtest/gtest.h>

#include <cmath>

#include "tests/second_stand/distance.h"
#include "tests/unit/second_stand/nominal.h"

namespace valvetriage::second_stand {
namespace {

TEST(Distance, NothingHiddenIsAtNoDistanceAndToneAtItsSignalToNoise) {
  const Distance distance({"staircase"});
  EXPECT_EQ(distance.measure(order_of({"staircase"})).d, 0);
  // No difference between units looks like a tone: √(4000 / 2) · 0.1 psi over the noise, its weak second line and the
  // gauge's loss at up to 40 Hz aside.
  const auto tone = distance.measure(order_of({"staircase"}, {{"periodic_disturbance", 0.1}}));
  EXPECT_NEAR(tone.d, std::sqrt(2000.0) * 0.1 / Conditions{}.noise_psi, 3);
}

TEST(Distance, WhatUnitsDifferByIsNoSign) {
  const Distance distance({"staircase"});
  const auto offset = distance.measure(order_of({"staircase"}, {{"sensor_offset", 1}}));
  // one offset of 1 psi beside a spread of 0.15 psi: at most 1 / 0.15, though 4,000 samples see it at 190
  EXPECT_LE(offset.d, 1 / 0.15);
  EXPECT_NEAR(offset.signal_to_noise, std::sqrt(4000.0) / Conditions{}.noise_psi, 0.1);
}

}  // namespace
}  // namespace valvetriage::second_stand
