#pragma once

#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/discrepancy/law_search.h"
#include "core/model/model.h"

namespace valvetriage {

/// A valve fitted together with the laws that explain it: none, one or several.
struct Explanation {
  std::unique_ptr<ValveFitOptions> options;
  std::unique_ptr<ValveFitProblem> problem;
  Eigen::VectorXd v;
  double cost = 0;           ///< whitened, penalties included
  std::vector<LawFit> laws;  ///< in the order of options->laws; their parameters as first found, v has the final ones
  /// The cost that the fit did not seem to come down to and was given up for; it may come to any below. None where it
  /// was led to its end.
  std::optional<double> given_up;

  Explanation copy() const;
  /// Of the law that came last, fitted together with the others (own ones: the first recording's).
  std::vector<double> parameters_of_last() const { return problem->law_parameters(v, laws.size() - 1, 0); }
  /// The extended model, laws included.
  Model model() const;
  /// Of every parameter of every law, in order (own ones: the first recording's). The larger of what inflated noise and
  /// what the spread of the scores over quarters of the recordings makes: a law that is not the whole physics would
  /// have other parameters in each. Source: White, Econometrica 50 (1982) 1 (sandwich), by clusters.
  std::vector<double> standard_errors(double inflation) const;
  /// The extended model moved by one standard deviation along each direction in which recordings and good valves leave
  /// it open: the valve's own parameters and map together with the laws'. Principal axes of their correlation.
  std::vector<Model> moved_models(double inflation) const;
};

/// The valve alone. recordings and everything in them must outlive the explanation.
Explanation explain_nothing(std::span<const Recording> recordings, const ValveFitOptions& options, const ValveFit& fit);
/// Where a joint fit may begin.
struct JointStart {
  Eigen::VectorXd baseline;        ///< as Explanation::v, without the law
  std::vector<double> parameters;  ///< of the law, as LawFit's
  /// Of the first differences, where free runs are rough; 0: wide ones (ValveFitProblem::width_at). What was found in
  /// free runs keeps its valley with 1.
  double width = 0;
};
/// The costs that a joint fit is led on for; infinite: to its end.
struct ToReach {
  /// At which it leads: one that at its pace would not come down to it ends early.
  double lead = std::numeric_limits<double>::infinity();
  /// At which it matters: one that does not seem to come down to it is given up where it stands.
  double matters = std::numeric_limits<double>::infinity();
};
/// One more law, everything fitted together from where its search ended, or from another start that is better after a
/// few iterations.
Explanation extend(const Explanation& explanation, const LawFit& law, int most_iterations, const ToReach& to_reach,
                   std::span<const JointStart> others = {});
/// The same from the starts alone, at least one: where the search ended has been tried before.
Explanation extend_from(std::span<const JointStart> starts, const Explanation& explanation, const LawFit& law,
                        int most_iterations, const ToReach& to_reach);
/// A fit that was given up, led on.
Explanation led_on(Explanation given_up, int most_iterations, const ToReach& to_reach);
/// One law less, the rest fitted again.
Explanation without(const Explanation& explanation, std::size_t law, int most_iterations);

/// What is left, one whitened column per recording.
Stack whitened_residual(const Explanation& explanation);

}  // namespace valvetriage
