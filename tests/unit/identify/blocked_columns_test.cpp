#include "core/identify/blocked_columns.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <utility>

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// 1,000 rows whose columns are something in a third of them, each its own third, and one that is so everywhere.
MatrixXd by_thirds() {
  MatrixXd m = MatrixXd::Zero(1000, 7);
  m.col(6) = VectorXd::LinSpaced(1000, -1, 2);
  for (Index j = 0; j < 6; ++j) {
    for (Index i = 333 * (j % 3); i < 333 * (j % 3) + 333; ++i)
      m(i, j) = std::sin(0.1 * static_cast<double>(i * (j + 1)));
  }
  return m;
}

TEST(BlockedColumns, MultiplyAsTheMatrixTheyAreMadeOf) {
  const MatrixXd m = by_thirds();
  const BlockedColumns blocked(m);
  const VectorXd left = VectorXd::LinSpaced(1000, 3, -2), right = VectorXd::LinSpaced(7, 1, 4);
  MatrixXd two(1000, 2);
  two << left, left.reverse();
  EXPECT_TRUE(blocked.gram(0, 1000).isApprox(m.transpose() * m, 1e-13));
  EXPECT_TRUE(blocked.transposed_times(0, two).isApprox(m.transpose() * two, 1e-13));
  EXPECT_TRUE(blocked.times(right).isApprox(m * right, 1e-13));
}

TEST(BlockedColumns, TakeAnyPartOfTheRows) {
  const MatrixXd m = by_thirds();
  const BlockedColumns blocked(m);
  for (const auto& [first, count] :
       {std::pair<Index, Index>{0, 1}, {100, 300}, {127, 2}, {128, 128}, {950, 50}, {5, 0}}) {
    const MatrixXd part = m.middleRows(first, count);
    const VectorXd left = VectorXd::LinSpaced(count, 1, 2);
    const double all = (m.transpose() * m).norm();
    EXPECT_LT((blocked.gram(first, count) - part.transpose() * part).norm(), 1e-13 * all) << first;
    EXPECT_LT((blocked.transposed_times(first, left) - part.transpose() * left).norm(), 1e-13 * all) << first;
  }
}

TEST(BlockedColumns, DoNotHideARunThatFailed) {
  MatrixXd m = MatrixXd::Ones(300, 1);
  m(10, 0) = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(std::isfinite(BlockedColumns(m).gram(0, 300)(0, 0)));
}

TEST(BlockedColumns, LeaveOutWhatIsLessThanRoundingOfItsColumn) {
  MatrixXd m = MatrixXd::Zero(256, 1);
  m(0, 0) = 1;
  m(200, 0) = 0.9e-15;
  EXPECT_EQ(BlockedColumns(m).times(VectorXd::Ones(1))(200), 0);
  m(200, 0) = 1.1e-15;
  EXPECT_EQ(BlockedColumns(m).times(VectorXd::Ones(1))(200), 1.1e-15);
}

}  // namespace
}  // namespace valvetriage
