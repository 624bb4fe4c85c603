#include "core/discrepancy/black_box.h"

#include <Eigen/Core>

#include "core/linear_algebra/solve.h"

namespace valvetriage {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

MatrixXd polynomials(const MatrixXd& states) {
  const Index n = states.cols();
  MatrixXd terms(states.rows(), 1 + n + n * (n + 1) / 2 + n);
  Index at = 0;
  terms.col(at++).setOnes();
  for (Index i = 0; i < n; ++i) terms.col(at++) = states.col(i);
  for (Index i = 0; i < n; ++i) {
    for (Index j = i; j < n; ++j) terms.col(at++) = states.col(i).cwiseProduct(states.col(j));
  }
  for (Index i = 0; i < n; ++i) terms.col(at++) = states.col(i).array().cube();
  return terms;
}

VectorXd ridge(const MatrixXd& square, const VectorXd& right, double strength) {
  const VectorXd scale = square.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  MatrixXd scaled = scale.asDiagonal() * square * scale.asDiagonal();
  scaled.diagonal().array() += strength;
  return scale.cwiseProduct(solve_symmetric(scaled, scale.cwiseProduct(right)));
}

}  // namespace valvetriage
