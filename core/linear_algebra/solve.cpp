#include "core/linear_algebra/solve.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <limits>

namespace valvetriage {

using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd solve_symmetric(const MatrixXd& a, const VectorXd& b) {
  return a.ldlt().solve(b);
}

MatrixXd inverse_of_symmetric(const MatrixXd& a) {
  return a.ldlt().solve(MatrixXd::Identity(a.rows(), a.rows()));
}

MatrixXd pseudo_inverse(const MatrixXd& a) {
  return a.completeOrthogonalDecomposition().pseudoInverse();
}

VectorXd least_squares(const MatrixXd& a, const VectorXd& b) {
  if (a.size() == 0) return VectorXd::Zero(a.cols());
  return a.completeOrthogonalDecomposition().solve(b);
}

VectorXd scaled_least_squares(const MatrixXd& a, const VectorXd& b) {
  const VectorXd scale = a.colwise().norm().cwiseMax(std::numeric_limits<double>::min());
  return least_squares(a * scale.cwiseInverse().asDiagonal(), b).cwiseQuotient(scale);
}

MatrixXd orthonormal_basis(const MatrixXd& a, double tolerance) {
  Eigen::ColPivHouseholderQR<MatrixXd> qr(a);
  qr.setThreshold(tolerance);
  return qr.householderQ() * MatrixXd::Identity(a.rows(), qr.rank());
}

SymmetricEigen symmetric_eigen(const MatrixXd& a) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(a);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

Eigen::VectorXcd eigenvalues(const MatrixXd& a) {
  return a.eigenvalues();
}

RightSingular right_singular(const MatrixXd& a) {
  const Eigen::JacobiSVD<MatrixXd> svd(a, Eigen::ComputeThinV);
  return {svd.singularValues(), svd.matrixV()};
}

}  // namespace valvetriage
