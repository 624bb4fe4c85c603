#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// What a simulation leaves of one recording, coarse enough to be laid beside another valve's: means over runs of equal
/// length.
///
///   b_k = mean of e over the valid samples of run k,  e = measured − simulated      [unit of the output]
struct BinnedResidual {
  Eigen::VectorXd value;       ///< one per run; NaN where no sample is valid
  std::vector<double> time_s;  ///< middle of each run, from the first sample
  double white_sd = 0;         ///< standard deviation that white noise of the residual gives a mean
};

/// simulated  n values, the free run
/// bins       at least 1; fewer where there are fewer samples
/// Cost       O(n log n)
BinnedResidual binned_residual(const Recording& recording, const std::vector<double>& simulated, std::size_t bins);

/// Residuals of many valves on the same tests as directions that can be compared: what good valves leave on the average
/// is taken off, what they scatter by is the unit, the length is 1.
///
///   s = (b − m) / d,   d_k² = (w² + Σ_i (g_ik − m_k)²) / (1 + n),   s / |s|
///
/// Two valves have s₁·s₂ = ρ, and |s₁ − s₂|² = 2 (1 − ρ).
///
/// residuals  v × p; NaN counts as what good valves leave
/// good       n × p, n ≥ 0; m = 0 without any
/// white_sd   p values: w above, the least scatter there can be
Eigen::MatrixXd residual_directions(const Eigen::MatrixXd& residuals, const Eigen::MatrixXd& good,
                                    const Eigen::VectorXd& white_sd);

}  // namespace valvetriage
