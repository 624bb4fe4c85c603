#include "server/report/downsample.h"

#include <gtest/gtest.h>
#include <rapidcheck.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace valvetriage::report {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::vector<double> times(std::size_t n) {
  std::vector<double> time_s(n);
  for (std::size_t i = 0; i < n; ++i) time_s[i] = 0.005 * static_cast<double>(i);
  return time_s;
}

TEST(Downsample, KeepsTheExtremesTheOrderAndTheBoundForAnySeries) {
  rc::check([] {
    const auto value = *rc::gen::container<std::vector<double>>(rc::gen::cast<double>(rc::gen::inRange(-1000, 1000)));
    const auto points = *rc::gen::inRange<std::size_t>(2, 60);
    const Points shown = downsample(times(value.size()), value, -kInfinity, kInfinity, points);
    RC_ASSERT(shown.value.size() == shown.time_s.size());
    RC_ASSERT(shown.value.size() <= points);
    RC_ASSERT(std::is_sorted(shown.time_s.begin(), shown.time_s.end()));
    if (value.empty()) return;
    RC_ASSERT(*std::max_element(shown.value.begin(), shown.value.end()) ==
              *std::max_element(value.begin(), value.end()));
    RC_ASSERT(*std::min_element(shown.value.begin(), shown.value.end()) ==
              *std::min_element(value.begin(), value.end()));
  });
}

TEST(Downsample, GivesEverySampleWhereThereIsRoom) {
  const std::vector<double> value{1, 1, 3, 2, 2};
  EXPECT_EQ(downsample(times(5), value, -kInfinity, kInfinity, 5).value, value);
  EXPECT_LE(downsample(times(5), value, -kInfinity, kInfinity, 4).value.size(), 4u);
}

TEST(Downsample, ShowsOneSampleSpikesOfALongSeries) {
  std::vector<double> value(54'900, 20.0);
  value[12'345] = 99;
  value[40'000] = -99;
  const Points shown = downsample(times(value.size()), value, -kInfinity, kInfinity, 200);
  EXPECT_EQ(std::count(shown.value.begin(), shown.value.end(), 99), 1);
  EXPECT_EQ(std::count(shown.value.begin(), shown.value.end(), -99), 1);
}

TEST(Downsample, CutsToTheTimesAskedForWithBothEnds) {
  const std::vector<double> time_s{0, 1, 2, 3}, value{0, 10, 20, 30};
  EXPECT_EQ(downsample(time_s, value, 1, 2, 10).value, (std::vector<double>{10, 20}));
  EXPECT_TRUE(downsample(time_s, value, 4, 9, 10).value.empty());
  EXPECT_TRUE(downsample(time_s, value, 2, 1, 10).value.empty());
}

TEST(Downsample, LeavesOutSamplesThatAreNotThere) {
  const double nan = std::nan("");
  const std::vector<double> value{nan, 5, nan, nan, 7, nan};
  EXPECT_EQ(downsample(times(6), value, -kInfinity, kInfinity, 2).value, (std::vector<double>{5, 7}));
}

}  // namespace
}  // namespace valvetriage::report
