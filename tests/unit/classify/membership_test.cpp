#include "core/classify/membership.h"

#include <gtest/gtest.h>
#include <rapidcheck/gtest.h>

#include <cmath>

namespace valvetriage {
namespace {

TEST(Membership, LeftTrapezoidIsEq21) {
  const Trapezoid low = left_trapezoid(1.4, 1.55);
  EXPECT_EQ(membership(low, 1.0), 1);
  EXPECT_EQ(membership(low, 1.4), 1);
  EXPECT_NEAR(membership(low, 1.475), 0.5, 1e-12);  // the corners are not exact in binary
  EXPECT_EQ(membership(low, 1.55), 0);
  EXPECT_EQ(membership(low, 1.6), 0);
}

TEST(Membership, RightTrapezoidIsEq21) {
  const Trapezoid high = right_trapezoid(1.45, 1.6);
  EXPECT_EQ(membership(high, 1.4), 0);
  EXPECT_EQ(membership(high, 1.45), 0);
  EXPECT_NEAR(membership(high, 1.525), 0.5, 1e-12);
  EXPECT_EQ(membership(high, 1.6), 1);
  EXPECT_EQ(membership(high, 9), 1);
}

TEST(Membership, TriangleIsEq22) {
  const Trapezoid second = triangle(0.5, 0.9, 1.2);
  EXPECT_EQ(membership(second, 0.5), 0);
  EXPECT_NEAR(membership(second, 0.7), 0.5, 1e-12);
  EXPECT_EQ(membership(second, 0.9), 1);
  EXPECT_NEAR(membership(second, 1.05), 0.5, 1e-12);
  EXPECT_EQ(membership(second, 1.2), 0);
}

TEST(Membership, VerticalEdgesBelongToTheSet) {
  const Trapezoid box{1, 1, 2, 2};
  EXPECT_EQ(membership(box, std::nextafter(1.0, 0.0)), 0);
  EXPECT_EQ(membership(box, 1), 1);
  EXPECT_EQ(membership(box, 2), 1);
  EXPECT_EQ(membership(box, std::nextafter(2.0, 3.0)), 0);
}

TEST(Membership, OfNotANumberIsZero) {
  EXPECT_EQ(membership(triangle(0, 1, 2), std::nan("")), 0);
}

TEST(Membership, TrapezoidsAreOrderedAndOpenOnlyByBothCornersOfASide) {
  EXPECT_TRUE(is_trapezoid({0, 1, 2, 3}));
  EXPECT_TRUE(is_trapezoid({-kOpen, -kOpen, kOpen, kOpen}));
  EXPECT_FALSE(is_trapezoid({0, 2, 1, 3}));
  EXPECT_FALSE(is_trapezoid({-kOpen, 1, 2, 3}));
  EXPECT_FALSE(is_trapezoid({0, 1, 2, kOpen}));
  EXPECT_FALSE(is_trapezoid({0, 1, std::nan(""), 3}));
}

RC_GTEST_PROP(Membership, StaysBetweenZeroAndOne,
              (int a, unsigned char ab, unsigned char bc, unsigned char cd, int x)) {
  const double start = a % 1000;
  const Trapezoid set{start, start + ab, start + ab + bc, start + ab + bc + cd};
  const double mu = membership(set, (x % 4000) / 3.0);
  RC_ASSERT(mu >= 0 && mu <= 1);
}

}  // namespace
}  // namespace valvetriage
