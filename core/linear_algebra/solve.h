#pragma once

#include <Eigen/Core>

/// Dense systems of the sizes met here, a few to a few hundred unknowns. Eigen's decompositions stand behind this
/// header because each takes seconds to compile wherever it is written out.
///
/// Shapes that do not fit are a mistake of the caller (Eigen asserts), and so are numbers that are not finite: pivots
/// are chosen past them, and what comes back may be finite and means nothing.
namespace valvetriage {

/// x of A x = b, by L D Lᵀ with pivots; what is singular in A is left at zero.
///
/// a        n × n, symmetric, positive or negative semidefinite; the lower triangle is read
/// b        n
Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);
/// A⁻¹ in the same way.
Eigen::MatrixXd inverse_of_symmetric(const Eigen::MatrixXd& a);
/// A⁺ by a complete orthogonal decomposition: the inverse where A has one.
Eigen::MatrixXd pseudo_inverse(const Eigen::MatrixXd& a);

/// x that makes |A x − b| least, and the smallest such x where columns depend on others within rounding; by a complete
/// orthogonal decomposition.
///
/// a        n × p, any n
/// b        n
Eigen::VectorXd least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);
/// The same of columns brought to length one first, for columns of different units; empty columns get a zero or no
/// share.
Eigen::VectorXd scaled_least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);

/// Orthonormal columns that span the columns of A; of columns that depend on others within `tolerance`, fewer.
///
/// returns  n × rank
Eigen::MatrixXd orthonormal_basis(const Eigen::MatrixXd& a, double tolerance);

/// A = V diag(λ) Vᵀ.
struct SymmetricEigen {
  Eigen::VectorXd values;   ///< n, ascending
  Eigen::MatrixXd vectors;  ///< n × n, in columns
};
/// a        n × n, symmetric; the lower triangle is read
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& a);
/// λ of A v = λ v for any square A, in no order.
Eigen::VectorXcd eigenvalues(const Eigen::MatrixXd& a);

/// What A = U diag(σ) Vᵀ has on the right, for A of n × p.
struct RightSingular {
  Eigen::VectorXd values;   ///< σ, min(n, p), descending
  Eigen::MatrixXd vectors;  ///< V, p × min(n, p)
};
RightSingular right_singular(const Eigen::MatrixXd& a);

}  // namespace valvetriage
