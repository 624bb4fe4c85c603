#include "core/identify/baseline.h"

#include <gtest/gtest.h>

#include "tests/unit/identify/plants.h"

namespace valvetriage {
namespace {

using namespace test;

std::vector<Recording> step_test(double noise, std::uint32_t seed) {
  std::vector<double> u(2400, 1.4);
  std::fill(u.begin() + 400, u.end(), 1.6);
  auto y = run(second_order_valve(), u);
  add_noise(y, noise, seed);
  return {recording_of({u.begin() + 300, u.end()}, {y.begin() + 300, y.end()}, 1.0 / 200)};
}

// Seventh order absorbs part of the bias that second order shows (rls_test), not all: 4.7 psi against 0.35 here.
TEST(Baseline, ThePaperFormIsFarOffWhereTheSelfBaselineReachesTheNoise) {
  const auto recordings = step_test(0.35, 1);
  const auto self = fit_self_baseline(recordings);
  ASSERT_TRUE(self.has_value());
  EXPECT_TRUE(self->identification.stable);
  EXPECT_NEAR(self->identification.run->rmse, 0.35, 0.02);
  EXPECT_NEAR(self->identification.static_gain, 470, 1);
  ASSERT_EQ(self->simulated.size(), 1u);
  EXPECT_EQ(self->simulated[0].size(), recordings[0].samples());

  const auto paper = fit_paper_baseline(recordings);
  ASSERT_TRUE(paper.has_value());
  EXPECT_EQ(paper->identification.structure.order, 7);
  if (paper->identification.stable) {
    EXPECT_GT(paper->identification.run->rmse, 5 * 0.35);
    EXPECT_GT(std::abs(paper->identification.static_gain - 470), 50);
  } else {
    EXPECT_TRUE(paper->simulated.empty());
    EXPECT_FALSE(paper->identification.notes.empty());
  }
}

TEST(Baseline, TheSelfModelSimulatesWhatTheFitRan) {
  const auto recordings = step_test(0.05, 2);
  const auto self = fit_self_baseline(recordings).value();
  const auto simulated = simulate(self.model, recordings[0], InitialState{});
  ASSERT_TRUE(simulated.has_value());
  // They differ in the initial state alone: estimated there, steady here.
  for (std::size_t t = 200; t < recordings[0].samples(); ++t) EXPECT_NEAR((*simulated)[t], self.simulated[0][t], 0.05);
}

}  // namespace
}  // namespace valvetriage
