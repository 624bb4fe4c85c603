#include "core/model/static_map.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>

namespace valvetriage {
namespace {

StaticMap paper_map() {
  return {.input = {1.2, 1.4, 1.6, 1.8, 2.0}, .output = {3.1, 26, 120, 160, 210}};
}

TEST(StaticMap, IsLinearBetweenKnotsAndGoesOnWithTheEndSlopes) {
  const StaticMap map = paper_map();
  EXPECT_DOUBLE_EQ(map(1.4), 26);
  EXPECT_DOUBLE_EQ(map(1.5), 73);
  EXPECT_DOUBLE_EQ(map(2.1), 235);
  EXPECT_NEAR(map(1.1), 3.1 - 11.45, 1e-12);
  EXPECT_NEAR(map.slope(1.5), 470, 1e-10);
  EXPECT_NEAR(map.slope(5), 250, 1e-10);
}

TEST(StaticMap, MapsASignalAsItMapsItsSamples) {
  const StaticMap map = paper_map();
  std::vector<double> signal;
  for (int i = 0; i < 200; ++i) signal.push_back(1.6 + 0.6 * std::sin(0.7 * i));
  signal.insert(signal.end(), map.input.begin(), map.input.end());
  std::vector<double> mapped = signal;
  map.apply(mapped);
  for (std::size_t i = 0; i < signal.size(); ++i) EXPECT_EQ(mapped[i], map(signal[i]));
}

TEST(StaticMap, InvertsWhatItMapsAndRefusesWhatItDoesNotReach) {
  const StaticMap map = paper_map();
  for (double u : {1.2, 1.23, 1.4, 1.77, 2.0}) EXPECT_NEAR(*map.inverse(map(u)), u, 1e-13);
  EXPECT_EQ(map.inverse(3.09).error().code, "outside_map");
  EXPECT_EQ(map.inverse(210.1).error().code, "outside_map");
  EXPECT_TRUE(map.inverse(210));
}

TEST(StaticMap, InvertsAFlatPieceToItsSmallestInput) {
  const StaticMap map{.input = {0, 1, 2, 3}, .output = {0, 5, 5, 6}};
  EXPECT_DOUBLE_EQ(*map.inverse(5), 1);
}

TEST(StaticMap, InvertsAFallingMap) {
  const StaticMap map{.input = {0, 1, 2}, .output = {10, 4, 0}};
  EXPECT_DOUBLE_EQ(*map.inverse(7), 0.5);
  EXPECT_DOUBLE_EQ(*map.inverse(2), 1.5);
  EXPECT_FALSE(map.inverse(10.1));
}

RC_GTEST_PROP(MonotoneRegression, IsMonotoneAndKeepsTheWeightedMean, (std::vector<double> raw)) {
  std::vector<double> values, weights;
  for (std::size_t i = 0; i < raw.size(); ++i) {
    values.push_back(std::sin(raw[i]));
    weights.push_back(0.5 + static_cast<double>(i % 3));
  }
  const auto fitted = monotone_regression(values, weights);
  RC_ASSERT(std::is_sorted(fitted.begin(), fitted.end()));
  const double before = std::inner_product(values.begin(), values.end(), weights.begin(), 0.0);
  const double after = std::inner_product(fitted.begin(), fitted.end(), weights.begin(), 0.0);
  RC_ASSERT(std::abs(before - after) < 1e-12 * (1.0 + static_cast<double>(raw.size())));
}

TEST(MonotoneRegression, PoolsViolatorsToTheirWeightedMean) {
  const std::vector<double> values{1, 3, 2, 4}, weights{1, 1, 3, 1};
  EXPECT_EQ(monotone_regression(values, weights), (std::vector<double>{1, 2.25, 2.25, 4}));
}

}  // namespace
}  // namespace valvetriage
