#pragma once

#include <Eigen/Core>

namespace valvetriage {

/// Parts of the black boxes that bound what any extension could reach (internal to discrepancy): a regression of the
/// residual on polynomials of states that remember the input.

/// 1, x_i, x_i x_j and x_i³ of the columns of `states`, one row each.
Eigen::MatrixXd polynomials(const Eigen::MatrixXd& states);

/// Weights of a ridge regression from its normal equations, `strength` relative to each regressor's own power.
Eigen::VectorXd ridge(const Eigen::MatrixXd& square, const Eigen::VectorXd& right, double strength);

}  // namespace valvetriage
