#include "core/identify/triangular_factor.h"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <utility>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

constexpr Eigen::Index kBlockRows = 192;  // with 20 columns about 34 KiB
constexpr double kDependent = 1e-12;      // of the longest column: below is rounding

/// Lengths of the columns, 1 for empty ones.
Eigen::VectorXd column_scale(const Eigen::MatrixXd& R) {
  Eigen::VectorXd scale = R.colwise().norm();
  for (auto& length : scale) length = length > 0 ? length : 1;
  return scale;
}

}  // namespace

Eigen::MatrixXd triangular_factor(const Eigen::Ref<const Eigen::MatrixXd>& rows, Eigen::MatrixXd start) {
  const Eigen::Index p = rows.cols();
  Eigen::MatrixXd R = start.size() > 0 ? std::move(start) : Eigen::MatrixXd(Eigen::MatrixXd::Zero(p, p));
  Eigen::MatrixXd block;
  for (Eigen::Index begin = 0; begin < rows.rows(); begin += kBlockRows) {
    block = rows.middleRows(begin, std::min(kBlockRows, rows.rows() - begin));
    for (Eigen::Index j = 0; j < p; ++j) {
      // Above the diagonal R has nothing to reflect with: the reflector is (R_jj, block column j).
      const double length = std::sqrt(R(j, j) * R(j, j) + block.col(j).squaredNorm());
      if (length == 0) continue;
      const double reflected = R(j, j) > 0 ? -length : length;
      const double head = R(j, j) - reflected;
      const double factor = -1 / (reflected * head);
      for (Eigen::Index k = j + 1; k < p; ++k) {
        const double projection = factor * (head * R(j, k) + block.col(j).dot(block.col(k)));
        R(j, k) -= projection * head;
        block.col(k) -= projection * block.col(j);
      }
      R(j, j) = reflected;
    }
  }
  return R;
}

Eigen::VectorXd solve_least_squares(const Eigen::MatrixXd& R, const Eigen::VectorXd& z, Eigen::Index* rank) {
  const Eigen::VectorXd scale = column_scale(R);
  Eigen::CompleteOrthogonalDecomposition<Eigen::MatrixXd> cod;
  cod.setThreshold(kDependent);
  cod.compute(R * scale.cwiseInverse().asDiagonal());
  if (rank != nullptr) *rank = cod.rank();
  return cod.solve(z).cwiseQuotient(scale);
}

Eigen::MatrixXd inverse_information(const Eigen::MatrixXd& R) {
  const Eigen::VectorXd scale = column_scale(R);
  const auto [values, vectors] = right_singular(R * scale.cwiseInverse().asDiagonal());
  const double least = std::max(values.size() > 0 ? values[0] * kDependent : 0.0, 1e-300);
  const Eigen::MatrixXd half =
      scale.cwiseInverse().asDiagonal() * vectors * values.cwiseMax(least).cwiseInverse().asDiagonal();
  return half * half.transpose();
}

}  // namespace valvetriage
