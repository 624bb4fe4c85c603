#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace valvetriage {

/// Autoregressive description of a residual: r_t = Σ φ_j r_{t−j} + e_t, var e = innovation_variance.
struct ColouredNoise {
  std::vector<double> phi;
  double innovation_variance = 0;
};

/// Levinson-Durbin on the sample autocovariance, the order by BIC (Schwarz 1978).
///
/// residual  n values, zero where not valid; `count` of them valid
/// Cost      n · largest order
ColouredNoise fit_coloured_noise(const Eigen::VectorXd& residual, std::size_t count, std::size_t largest_order);

/// Tᵀ x for the covariance σ² T Tᵀ of the noise: xᵀ Γ x = σ² |Tᵀ x|². Backwards in time, column by column, in place.
void colour_backwards(const ColouredNoise& noise, Eigen::MatrixXd& columns);

}  // namespace valvetriage
