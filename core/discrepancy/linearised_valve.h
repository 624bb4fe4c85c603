#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <span>
#include <vector>

#include "core/identify/valve_fit_problem.h"

namespace valvetriage {

/// One whitened column per recording, at the rows of a linearisation.
using Stack = std::vector<Eigen::VectorXd>;

/// A fitted valve and everything linear about it: what a signature must be projected off before it counts.
///
///   ⟨a, b⟩ = aᵀb − (Jᵀa)ᵀ (JᵀJ + Π)⁻¹ (Jᵀb)
///
/// J are the sensitivities of everything the fit is free to move, whitened by the noise, Π its prior. What is left of a
/// signature in this product is what neither the valve's own parameters within their population nor its map nor its
/// initial states can absorb.
class LinearisedValve {
 public:
  /// v: a minimum of the problem's cost, or near one. Cost: one linearisation, O(samples · size²)
  LinearisedValve(const ValveFitProblem& problem, Eigen::VectorXd v);

  const ValveFitProblem& problem() const { return problem_; }
  const Eigen::VectorXd& at() const { return v_; }
  const Stack& error() const { return error_; }  ///< whitened residual
  const std::vector<ValveFitProblem::Rows>& rows() const { return rows_; }
  double samples() const { return samples_; }
  double cost() const { return cost_; }  ///< of the fit, simulated

  /// Standard errors of the fit's vector by the noise of the samples, so many times as much of it as if it were white.
  /// What the prior alone holds has none.
  Eigen::VectorXd errors(double inflation) const;

  /// A free run's difference from this fit's own, whitened at the rows.
  Eigen::VectorXd whitened(std::size_t recording, std::span<const double> simulated) const;
  /// The fit's own free run.
  const ValveFitProblem::Run& run(std::size_t recording) const { return runs_[recording]; }
  std::span<const ValveFitProblem::Run> runs() const { return runs_; }

  /// A column with what the fit can absorb of it.
  struct Signature {
    Stack column;
    Eigen::VectorXd load;      ///< Jᵀ column
    Eigen::VectorXd absorbed;  ///< (JᵀJ + Π)⁻¹ load
  };
  Signature signature(Stack column) const;
  /// Of several columns at once: the sensitivities are read once for all of them.
  std::vector<Signature> signatures(std::vector<Stack> columns) const;
  double product(const Signature& a, const Signature& b) const;
  /// The part of ⟨a, a⟩ that the samples tell; the rest of it is the prior's.
  double told_by_samples(const Signature& a) const;
  /// ⟨a, error⟩, the prior's pull included where v is no exact minimum.
  double against_error(const Signature& a) const;
  /// Cost of the baseline's best fit once `taken` has been taken off its error, relative to that of nothing taken.
  double cost_without(const Signature& taken) const;
  /// The whitened residual that is left when `taken` is explained otherwise and the fit has moved.
  Stack residual_without(const Signature& taken) const;
  /// The whitened residual once the fit has made the step it would still make: zero near a minimum.
  Stack residual_alone() const;
  /// How the fit's own vector moves when `taken` is explained otherwise.
  Eigen::VectorXd shift_without(const Signature& taken) const;

 private:
  /// Holds what lies at a bound and would move beyond it: a fit that cannot go there absorbs nothing that way.
  void hold_at_bounds();
  /// `left` less what a move of the fit's vector explains.
  Stack moved(Stack left, const Eigen::VectorXd& shift) const;

  const ValveFitProblem& problem_;
  Eigen::VectorXd v_;
  std::vector<ValveFitProblem::Rows> rows_;
  Stack error_;
  std::vector<ValveFitProblem::Run> runs_;
  ValveFitProblem::Normal normal_;
  Eigen::MatrixXd by_samples_;  ///< normal_.a without the prior
  std::vector<Eigen::Index> held_;
  Eigen::LDLT<Eigen::MatrixXd> factor_;
  Eigen::VectorXd newton_;  ///< (JᵀJ + Π)⁻¹ b: what one more step of the fit would do
  double samples_ = 0, cost_ = 0;
};

}  // namespace valvetriage
