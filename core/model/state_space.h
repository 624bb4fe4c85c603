#pragma once

#include <Eigen/Dense>
#include <complex>
#include <vector>

#include "core/model/transfer_function.h"

namespace valvetriage {

/// One real pole (imaginary part 0) or one conjugate pair: re ± j im.
struct PoleBlock {
  double re = 0;
  double im = 0;
  bool is_pair() const { return im != 0; }
};

/// Dense state space of a transfer function without its delay, as a cascade of first- and second-order sections.
///
///   x' = A x + B u,  y = C x + D u        (x' the derivative, or the next sample)
///
/// A is block lower triangular; `blocks` are its diagonal blocks from the last state to the first, which is the order
/// in which ChainForm takes the poles off. A pair owns the two states [[re, −im²], [1, re]].
struct StateSpace {
  Eigen::MatrixXd a;
  Eigen::VectorXd b;
  Eigen::RowVectorXd c;
  double d = 0;
  std::vector<PoleBlock> blocks;
};

/// Errors: not_finite, improper, not_conjugate. Zeros are paired with the nearest poles so that no section rounds away
/// what the next one restores.
Result<StateSpace> cascade(const TransferFunction& g);

/// Observer chain: the form in which everything is simulated.
///
///   x_j⁺ = diagonal_j x_j + lower_j x_{j−1} + x_{j+1} + (input u)_j,   y = x_0 + direct u
///
/// Each pole stands in the recursion as itself, not in an expanded polynomial, so poles that cluster near z = 1 stay
/// where they are; a conjugate pair σ ± jω takes two states with lower = 0, −ω². One sample costs 3 + m products per
/// state for m input columns.
struct ChainForm {
  std::vector<double> diagonal, lower;
  Eigen::MatrixXd input;      ///< order × columns
  Eigen::RowVectorXd direct;  ///< columns
  std::vector<PoleBlock> blocks;
};

/// The chain form of x⁺ = Φ x + Γ v, y = C x + D v, where Φ is block lower triangular with the given diagonal blocks
/// (last state first). Row vectors w_0 = C, w_{j+1} = w_j (Φ − p_j I) give x_j = w_j x and input row w_j Γ.
ChainForm chain_form(const Eigen::MatrixXd& phi, const Eigen::MatrixXd& gamma, const Eigen::RowVectorXd& c,
                     const Eigen::RowVectorXd& d, const std::vector<PoleBlock>& blocks);

/// The chain's transfer function from its only input column: gain, zeros, poles. Leading coefficients that contribute
/// less than `negligible` of the largest one at |x − centre| = 1 are taken as zero.
TransferFunction chain_transfer_function(const ChainForm& chain, Domain domain, double negligible);

/// A continuous system sampled at unit period behind a fractional delay f, 0 ≤ f < 1, with its input described per
/// interval i by the value u_i at the interval's start and its rise Δ_i over the interval (0 where it is held):
///
///   x_{k+1} = Φ x_k + [u_k, Δ_k, u_{k−1}, Δ_{k−1}] columns,     the last two only where f > 0
struct Sampled {
  Eigen::MatrixXd phi;
  Eigen::MatrixXd gamma;  ///< order × 2, or × 4 with a fractional delay
  Eigen::RowVectorXd c;
  Eigen::RowVectorXd direct;  ///< per column
  std::vector<PoleBlock> blocks;
};

/// A delay as whole samples and a fraction 0 ≤ f < 1.
struct SplitDelay {
  int whole = 0;
  double fraction = 0;
};
SplitDelay split_delay(double delay_s, double sample_time_s);

/// Exact sampling of the continuous system by the matrix exponential; the whole part of the delay is left out.
/// Errors: as cascade; not_positive for the sample time.
Result<Sampled> sample(const TransferFunction& continuous, double sample_time_s);

}  // namespace valvetriage
