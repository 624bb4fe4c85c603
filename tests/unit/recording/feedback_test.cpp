#include "core/recording/feedback.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/recording/signals.h"

namespace valvetriage {
namespace {

Recording record_of(Signal u, Signal y) {
  return prepared(raw_of(std::move(u), std::move(y)));
}

/// A lag of ten samples about 1.6 A, 100 psi an ampere, exact for a held input.
Signal behind_lag(const Signal& u) {
  Signal y(u.size());
  double state = 100 * u.front();
  for (std::size_t t = 0; t < u.size(); ++t) {
    y[t] = state;
    state += 0.095 * (100 * u[t] - state);
  }
  return y;
}

TEST(OutputFollowed, ALoopIsRegulatedHoweverLittleNoiseItHas) {
  for (const double noise : {0.001, 0.35}) {
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    Signal u, y;
    double pressure = 120, load = 0, integral = 1.6;
    for (int i = 0; i < 3000; ++i) {
      load = 0.995 * load + 0.4 * normal(random);
      y.push_back(pressure + load + noise * normal(random));
      integral -= 0.0005 * (y.back() - 120);
      u.push_back(integral - 0.003 * (y.back() - 120));
      pressure += (150 * (u.back() - 0.8) - pressure) * 0.08;
    }
    EXPECT_TRUE(output_followed(record_of(u, y)).is_regulated()) << noise;
  }
}

TEST(OutputFollowed, ADrawnCommandIsNotRegulatedHoweverLittleNoiseItsMachineHas) {
  for (const double noise : {0.0, 0.001, 0.1}) {
    for (const Signal& u : {triangle_of(4000, 2000), swept_sine_of(4000), multisine_of(4000, 2)}) {
      Signal y = behind_lag(u);
      if (noise > 0) add_noise(y, noise, 3);
      EXPECT_FALSE(output_followed(record_of(u, y)).is_regulated()) << noise;
    }
  }
}

TEST(OutputFollowed, OfATriangleALagTellsNearlyAllAndNothingThatTheTriangleHasNotTold) {
  const Signal u = triangle_of(4000, 2000);
  const OutputFollowed followed = output_followed(record_of(u, behind_lag(u)));
  EXPECT_GT(followed.of_all, 0.75);
  EXPECT_LT(followed.beyond_past, 0.1);
}

TEST(OutputFollowed, AMachineThatAnswersAtOnceIsNoController) {
  Signal u(4000, 1.6), y;
  add_noise(u, 0.1, 4);
  for (const double x : u) y.push_back(100 * x);
  add_noise(y, 0.1, 5);
  const OutputFollowed followed = output_followed(record_of(u, y));
  EXPECT_GT(followed.of_all, 0.75);
  EXPECT_FALSE(followed.is_regulated());
}

TEST(OutputFollowed, TooFewSamplesTellNothing) {
  const Signal u = multisine_of(40, 6);
  Recording few;
  few.input.values = u;
  few.output.values = behind_lag(u);
  EXPECT_EQ(output_followed(few).of_all, 0);
  EXPECT_EQ(output_followed(few).beyond_past, 0);
}

}  // namespace
}  // namespace valvetriage
