#include <gtest/gtest.h>

#include <random>
#include <set>

#include "core/classify/rivals/possibilistic_c_means.h"

namespace valvetriage {
namespace {

constexpr PossibilisticOptions kSharp{.fuzzifier = 1.5, .most_iterations = 100};

/// Unit vectors: `each` around each of the given axes of 40, then `alone` in directions of their own.
Eigen::MatrixXd directions(const std::vector<int>& axes, int each, int alone, double noise) {
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  const auto n = Eigen::Index(axes.size()) * each + alone;
  Eigen::MatrixXd x(n, 40);
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index j = 0; j < 40; ++j) x(i, j) = normal(random);
    const auto group = std::size_t(i / each);
    if (group < axes.size()) {
      x.row(i) *= noise / std::sqrt(40.0);
      x(i, axes[group]) += 1;
    }
    x.row(i).normalize();
  }
  return x;
}

TEST(PossibilisticGroups, AreAsManyAsThereAreAndLeaveOutWhatLiesAlone) {
  const auto groups = possibilistic_groups(directions({3, 17}, 6, 9, 0.4), 0.5, kSharp);
  ASSERT_EQ(groups.size(), 2u);
  std::set<std::size_t> all;
  for (const PatternGroup& group : groups) {
    EXPECT_EQ(group.members.size(), 6u);
    const std::size_t first = *std::min_element(group.members.begin(), group.members.end());
    for (const std::size_t member : group.members) EXPECT_EQ(member / 6, first / 6);
    EXPECT_TRUE(std::is_sorted(group.typicality.rbegin(), group.typicality.rend()));
    EXPECT_GE(group.typicality.back(), 0.5);
    all.insert(group.members.begin(), group.members.end());
  }
  EXPECT_EQ(all.size(), 12u);
  EXPECT_EQ(*all.rbegin(), 11u);
}

TEST(PossibilisticGroups, OfDirectionsWithoutAPatternAreNone) {
  EXPECT_TRUE(possibilistic_groups(directions({}, 1, 30, 1), 0.5, kSharp).empty());
}

TEST(PossibilisticGroups, AreFoundAmongThousandsThatLieAlone) {
  const auto groups = possibilistic_groups(directions({3, 17, 29}, 8, 2500, 0.4), 0.5, kSharp);
  std::set<std::set<std::size_t>> found;
  for (const PatternGroup& group : groups) {
    std::set<std::size_t> members;
    for (const std::size_t member : group.members) {
      if (member < 24) members.insert(member);
    }
    if (!members.empty()) found.insert(members);
  }
  // Of 2500 random directions a few point along a group by chance (a correlation of 0.7 is 4.5 standard deviations of
  // 1/√40 away), or along each other; the groups keep all their own.
  EXPECT_EQ(found, (std::set<std::set<std::size_t>>{
                       {0, 1, 2, 3, 4, 5, 6, 7}, {8, 9, 10, 11, 12, 13, 14, 15}, {16, 17, 18, 19, 20, 21, 22, 23}}));
  std::size_t strangers = 0;
  for (const PatternGroup& group : groups) {
    for (const std::size_t member : group.members) strangers += member >= 24;
  }
  EXPECT_LT(strangers, 125u);  // 5 %
}

TEST(PossibilisticGroups, AreTheDensestWhereThereAreMoreThanStarts) {
  // Thirty pairs and, last in the order of rows, a group of ten.
  std::vector<int> axes;
  for (int axis = 0; axis < 30; ++axis) axes.push_back(axis);
  const Eigen::MatrixXd pairs = directions(axes, 2, 0, 0.3), ten = directions({35}, 10, 0, 0.3);
  Eigen::MatrixXd x(70, 40);
  x << pairs, ten;
  const auto every = possibilistic_groups(x, 0.5, kSharp);
  EXPECT_EQ(every.size(), 31u);
  PossibilisticOptions few = kSharp;
  few.most_starts = 4;
  const auto densest = possibilistic_groups(x, 0.5, few);
  ASSERT_EQ(densest.size(), 4u);
  EXPECT_EQ(densest[0].members.size(), 10u);
  EXPECT_EQ(*std::min_element(densest[0].members.begin(), densest[0].members.end()), 60u);
}

TEST(PossibilisticGroups, OfNothingAreNone) {
  EXPECT_TRUE(possibilistic_groups(Eigen::MatrixXd(0, 0), 0.5).empty());
}

TEST(PossibilisticGroups, OfEqualRowsAreOne) {
  const auto groups = possibilistic_groups(Eigen::MatrixXd::Ones(5, 3), 0.5);
  ASSERT_EQ(groups.size(), 1u);
  EXPECT_EQ(groups[0].members, (std::vector<std::size_t>{0, 1, 2, 3, 4}));
  EXPECT_NEAR(groups[0].prototype(1), 1, 1e-12);
}

}  // namespace
}  // namespace valvetriage
