#include "core/identify/knot_curve.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace valvetriage {
namespace {

std::vector<double> knots(std::size_t count) {
  std::vector<double> inputs;
  for (std::size_t k = 0; k < count; ++k) inputs.push_back(1 + 0.025 * static_cast<double>(k));
  return inputs;
}

template <typename Curve>
std::vector<double> at(const std::vector<double>& inputs, Curve curve) {
  std::vector<double> outputs;
  for (const double u : inputs) outputs.push_back(curve(u));
  return outputs;
}

double s_curve(double u) {
  return 100 + 100 * std::tanh((u - 1.5) / 0.12);
}

TEST(KnotCurve, PassesThroughItsKnots) {
  const std::vector<double> inputs = knots(41), outputs = at(inputs, s_curve);
  const StaticMap map = KnotCurve(inputs).through(outputs);
  for (std::size_t k = 0; k < inputs.size(); ++k) EXPECT_NEAR(map(inputs[k]), outputs[k], 1e-9);
}

TEST(KnotCurve, FollowsAParabolaUpToItsEnds) {
  const auto parabola = [](double u) { return 3 - 2 * u + 50 * u * u; };
  for (const std::size_t count : {3U, 4U, 5U, 12U}) {
    const std::vector<double> inputs = knots(count);
    const StaticMap map = KnotCurve(inputs).through(at(inputs, parabola));
    for (std::size_t i = 0; i < map.input.size(); ++i) EXPECT_NEAR(map.output[i], parabola(map.input[i]), 1e-9);
  }
}

TEST(KnotCurve, IsTenTimesNearerToAValvesMapThanStraightPieces) {
  const std::vector<double> inputs = knots(41), outputs = at(inputs, s_curve);
  const StaticMap straight{inputs, outputs}, smooth = KnotCurve(inputs).through(outputs);
  double of_straight = 0, of_smooth = 0;
  for (double u = 1; u < 2; u += 0.001) {
    of_straight = std::max(of_straight, std::abs(straight(u) - s_curve(u)));
    of_smooth = std::max(of_smooth, std::abs(smooth(u) - s_curve(u)));
  }
  EXPECT_GT(of_straight, 0.3);
  EXPECT_LT(of_smooth, 0.1 * of_straight);
}

TEST(KnotCurve, FallsNowhereInAModelThatIsHandedOut) {
  const std::vector<double> inputs = knots(8), outputs{1, 1, 1, 40, 80, 80, 80, 80};
  const KnotCurve curve(inputs);
  const StaticMap map = curve.rising_through(outputs);
  const std::vector<double> bare = curve.through(outputs).output;
  EXPECT_FALSE(std::is_sorted(bare.begin(), bare.end()));
  EXPECT_TRUE(std::is_sorted(map.output.begin(), map.output.end()));
  for (std::size_t i = 0; i < bare.size(); ++i) EXPECT_NEAR(map.output[i], bare[i], 4);
}

TEST(KnotCurve, IsAStraightLineThroughTwoKnots) {
  const StaticMap map = KnotCurve({1, 2}).through({10, 30});
  for (const double u : {0.5, 1.0, 1.3, 2.0, 2.5}) EXPECT_NEAR(map(u), 10 + 20 * (u - 1), 1e-9);
}

TEST(KnotCurve, SharesAreWhatAKnotMovesInTheMap) {
  for (const std::size_t count : {2U, 3U, 4U, 9U}) {
    const std::vector<double> inputs = knots(count);
    const KnotCurve curve(inputs);
    for (std::size_t knot = 0; knot < count; ++knot) {
      std::vector<double> moved(count, 0.0);
      moved[knot] = 1;
      const StaticMap map = curve.through(moved);
      for (double u = 0.99; u < inputs.back() + 0.01; u += 0.0017) {
        const KnotCurve::Share share = curve.share_at(u);
        const std::size_t k = knot - share.first;
        EXPECT_NEAR(k < share.weight.size() ? share.weight[k] : 0, map(u), 1e-9) << count << ' ' << knot << ' ' << u;
      }
    }
  }
}

}  // namespace
}  // namespace valvetriage
