#pragma once

#include <Eigen/Dense>
#include <vector>

#include "tests/hidden_effects/bench.h"

namespace valvetriage::hidden_effects {

constexpr double kNoisePsi = 0.35;

/// No fault in any recording of the bench.
std::vector<stand::Faults> healthy(const TwinBench& bench);

/// Unit parameters moved by z population standard deviations; none below a twentieth of its value.
stand::Unit moved(const stand::Unit& unit, const Eigen::VectorXd& z);

/// What a baseline can absorb, around the unit of a bench: its sensitivities and their orthogonal basis. A fit moves
/// along them but is measured by simulation, so that they need not be the unit's own.
struct Absorption {
  explicit Absorption(const TwinBench& bench);

  Eigen::Index parameters() const;  ///< of the unit; the other columns are pasts and first holds
  /// [(y − f)/σ; −θ] and [column/σ; 0]
  Eigen::VectorXd stacked(const Eigen::VectorXd& error_psi, const Eigen::VectorXd& theta) const;
  Eigen::VectorXd stacked(const Eigen::VectorXd& column_psi) const;
  Eigen::VectorXd off_baseline(const Eigen::VectorXd& rho) const;

  Eigen::MatrixXd columns;   ///< [psi] per population standard deviation, then the pasts and the first holds
  Eigen::MatrixXd basis;     ///< of [columns/σ; I]
  Eigen::MatrixXd triangle;  ///< [columns/σ; I] = basis · triangle
};

}  // namespace valvetriage::hidden_effects
