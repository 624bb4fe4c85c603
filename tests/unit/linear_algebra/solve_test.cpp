#include "core/linear_algebra/solve.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Entries are standard normal.
MatrixXd random_matrix(Index rows, Index columns, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  return MatrixXd::NullaryExpr(rows, columns, [&] { return normal(random); });
}

MatrixXd random_positive(Index size, unsigned seed) {
  const MatrixXd a = random_matrix(size + 5, size, seed);
  return a.transpose() * a;
}

TEST(Solve, GivesBackWhatASymmetricMatrixWasMultipliedWith) {
  const MatrixXd a = random_positive(8, 1);
  const VectorXd x = random_matrix(8, 1, 2);
  EXPECT_LT((solve_symmetric(a, a * x) - x).norm(), 1e-9 * x.norm());
  EXPECT_LT((inverse_of_symmetric(a) * a - MatrixXd::Identity(8, 8)).norm(), 1e-9);
}

TEST(Solve, LeavesWhatIsSingularAtZero) {
  MatrixXd a = random_positive(5, 3);
  a.row(2).setZero();
  a.col(2).setZero();
  const VectorXd x = solve_symmetric(a, VectorXd::Ones(5));
  EXPECT_EQ(x(2), 0);
  VectorXd others = a * x;
  others(2) = 1;
  EXPECT_LT((others - VectorXd::Ones(5)).norm(), 1e-9);
}

TEST(Solve, ReadsTheLowerTriangleAlone) {
  const MatrixXd whole = random_positive(6, 4);
  MatrixXd lower = whole;
  lower.triangularView<Eigen::StrictlyUpper>().setConstant(99);
  const VectorXd b = random_matrix(6, 1, 5);
  EXPECT_EQ(solve_symmetric(lower, b), solve_symmetric(whole, b));
  EXPECT_EQ(symmetric_eigen(lower).values, symmetric_eigen(whole).values);
}

TEST(LeastSquares, LeavesNothingAlongTheColumns) {
  const MatrixXd a = random_matrix(40, 6, 6);
  const VectorXd b = random_matrix(40, 1, 7);
  EXPECT_LT((a.transpose() * (a * least_squares(a, b) - b)).norm(), 1e-10);
}

TEST(LeastSquares, SharesOutWhatTwoLikeColumnsExplain) {
  MatrixXd a = random_matrix(30, 3, 8);
  a.col(2) = a.col(0);
  const VectorXd x = least_squares(a, 4 * a.col(0));
  EXPECT_NEAR(x(0), 2, 1e-9);
  EXPECT_NEAR(x(1), 0, 1e-9);
  EXPECT_NEAR(x(2), 2, 1e-9);
}

TEST(LeastSquares, OfFewerRowsThanColumnsFollowsThemWithTheSmallest) {
  const MatrixXd a = random_matrix(3, 7, 9);
  const VectorXd b = random_matrix(3, 1, 10);
  const VectorXd x = least_squares(a, b);
  EXPECT_LT((a * x - b).norm(), 1e-10);
  EXPECT_LT((x - pseudo_inverse(a) * b).norm(), 1e-10);
}

TEST(LeastSquares, OfScaledColumnsDoesNotDependOnTheirUnits) {
  const MatrixXd a = random_matrix(25, 4, 11);
  const VectorXd b = random_matrix(25, 1, 12);
  const Eigen::Vector4d units(1, 1e-14, 1e9, 1e3);
  const VectorXd x = scaled_least_squares(a * units.asDiagonal(), b);
  EXPECT_LT((x.cwiseProduct(units) - least_squares(a, b)).norm(), 1e-10);
}

TEST(LeastSquares, GivesAnEmptyScaledColumnNoShare) {
  MatrixXd a = random_matrix(25, 3, 13);
  a.col(1).setZero();
  const VectorXd x = scaled_least_squares(a, a.col(0) - 2 * a.col(2));
  EXPECT_NEAR(x(0), 1, 1e-10);
  EXPECT_EQ(x(1), 0);
  EXPECT_NEAR(x(2), -2, 1e-10);
}

TEST(LeastSquares, OfNoColumnsOrNoRowsIsNothing) {
  EXPECT_EQ(least_squares(MatrixXd(40, 0), VectorXd::Ones(40)).size(), 0);
  EXPECT_EQ(scaled_least_squares(MatrixXd(40, 0), VectorXd::Ones(40)).size(), 0);
  EXPECT_EQ(least_squares(MatrixXd(0, 3), VectorXd(0)), VectorXd::Zero(3));
}

TEST(OrthonormalBasis, SpansTheColumnsAndNoMore) {
  MatrixXd a = random_matrix(20, 4, 14);
  a.col(3) = a.col(0) - a.col(1);
  const MatrixXd q = orthonormal_basis(a, 1e-9);
  ASSERT_EQ(q.rows(), 20);
  ASSERT_EQ(q.cols(), 3);
  EXPECT_LT((q.transpose() * q - MatrixXd::Identity(3, 3)).norm(), 1e-12);
  EXPECT_LT((a - q * (q.transpose() * a)).norm(), 1e-9);
}

TEST(Eigenvalues, OfASymmetricMatrixAscendAndPutItTogetherAgain) {
  const MatrixXd a = random_positive(7, 15) - 4 * MatrixXd::Identity(7, 7);
  const SymmetricEigen of = symmetric_eigen(a);
  for (Index i = 1; i < of.values.size(); ++i) EXPECT_LE(of.values(i - 1), of.values(i));
  EXPECT_LT((of.vectors * of.values.asDiagonal() * of.vectors.transpose() - a).norm(), 1e-9);
}

TEST(Eigenvalues, OfARotationAreAPairOnTheUnitCircle) {
  const double angle = 0.3;
  MatrixXd a(2, 2);
  a << std::cos(angle), -std::sin(angle), std::sin(angle), std::cos(angle);
  const Eigen::VectorXcd found = eigenvalues(a);
  ASSERT_EQ(found.size(), 2);
  for (Index i = 0; i < 2; ++i) {
    EXPECT_NEAR(found(i).real(), std::cos(angle), 1e-12);
    EXPECT_NEAR(std::abs(found(i).imag()), std::sin(angle), 1e-12);
  }
  EXPECT_NEAR(found(0).imag() + found(1).imag(), 0, 1e-12);
}

TEST(RightSingular, ValuesDescendAndAreWhatTheVectorsComeOutAs) {
  for (const auto& [rows, columns] : {std::pair<Index, Index>{12, 5}, {5, 12}}) {
    const MatrixXd a = random_matrix(rows, columns, 16);
    const RightSingular of = right_singular(a);
    ASSERT_EQ(of.values.size(), 5);
    ASSERT_EQ(of.vectors.rows(), columns);
    ASSERT_EQ(of.vectors.cols(), 5);
    for (Index i = 0; i < 5; ++i) {
      EXPECT_NEAR((a * of.vectors.col(i)).norm(), of.values(i), 1e-9);
      if (i > 0) {
        EXPECT_LE(of.values(i), of.values(i - 1));
      }
    }
  }
}

}  // namespace
}  // namespace valvetriage
