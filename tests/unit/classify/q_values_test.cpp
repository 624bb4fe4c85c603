#include "core/classify/q_values.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace valvetriage {
namespace {

TEST(QValues, AreTheExpectedShareOfFalseNamesAmongThoseAtLeastAsProbable) {
  const std::vector<double> q = q_values(std::vector{0.96, 1.0, 0.98});
  EXPECT_NEAR(q[1], 0, 1e-15);
  EXPECT_NEAR(q[2], 0.02 / 2, 1e-15);
  EXPECT_NEAR(q[0], 0.06 / 3, 1e-15);
}

TEST(QValues, AreOneForEqualProbabilitiesWhateverTheirOrder) {
  for (const double q : q_values(std::vector{0.97, 0.97, 0.97})) EXPECT_NEAR(q, 0.03, 1e-15);
  EXPECT_TRUE(q_values({}).empty());
}

TEST(QValues, HoldWhatTheyPromiseWhereTheProbabilitiesAreRight) {
  // 20,000 lots of 40 names, each true with the probability it was given; names with q ≤ 0.02 are taken as true. The
  // share of false ones among them is q's mean over the names taken, known to 0.0002 (one standard deviation).
  std::mt19937 random(11);
  std::uniform_real_distribution<double> unit;
  double taken = 0, false_names = 0, promised = 0;
  for (int lot = 0; lot < 20'000; ++lot) {
    std::vector<double> probabilities(40);
    for (double& p : probabilities) p = 0.95 + 0.05 * unit(random);
    const std::vector<double> q = q_values(probabilities);
    for (std::size_t i = 0; i < q.size(); ++i) {
      if (q[i] > 0.02) continue;
      ++taken;
      promised += 1 - probabilities[i];
      false_names += unit(random) > probabilities[i] ? 1 : 0;
    }
  }
  EXPECT_NEAR(false_names / taken, promised / taken, 0.001);
  EXPECT_LE(promised / taken, 0.02);
}

TEST(ExpectedFalse, IsWhatIsMissingToCertainty) {
  EXPECT_NEAR(expected_false(std::vector{0.96, 1.0, 0.98}), 0.06, 1e-15);
}

}  // namespace
}  // namespace valvetriage
