#pragma once

#include <Eigen/Core>

namespace valvetriage {

/// R of A = Q R by Householder reflections, taken a block of rows at a time so that it stays in the cache.
///
/// rows     n × p, any n
/// start    R of rows already seen, p × p; none if empty
/// returns  p × p upper triangular (zero rows at the bottom where n < p)
/// Cost     2 n p²; one buffer of the size of a block
Eigen::MatrixXd triangular_factor(const Eigen::Ref<const Eigen::MatrixXd>& rows, Eigen::MatrixXd start = {});

/// argmin |R x − z| for upper triangular R, columns scaled to length one first. Where columns depend on others within
/// rounding, the smallest solution; `rank` (if asked for) tells.
Eigen::VectorXd solve_least_squares(const Eigen::MatrixXd& R, const Eigen::VectorXd& z, Eigen::Index* rank = nullptr);

/// (RᵀR)⁻¹, columns scaled first; directions without information give a large but finite variance.
Eigen::MatrixXd inverse_information(const Eigen::MatrixXd& R);

}  // namespace valvetriage
