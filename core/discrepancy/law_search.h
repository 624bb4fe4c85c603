#pragma once

#include <optional>
#include <vector>

#include "core/discrepancy/evidence.h"
#include "core/discrepancy/linearised_valve.h"

namespace valvetriage {

/// What a search for one law found.
struct LawFit {
  LawInFit law;                    ///< bounds, and where it acts
  std::vector<double> parameters;  ///< shared ones, then each recording's own
  std::vector<double> shape;       ///< parameters at which the law has an effect, even where none was found
  double reduction = 0;            ///< of the whitened cost, everything the valve can absorb taken off, ≥ 0
  double verified = 0;             ///< the same with the valve's own moves simulated too, ≥ 0
  Evidence consistent_reduction;   ///< of the forecast
  Evidence consistent_verified;    ///< of the simulation
  Eigen::Index freedoms = 0;       ///< parameters fitted
  Eigen::VectorXd baseline;        ///< the linearised fit's vector, moved to where it would be beside the law
  Stack residual;                  ///< whitened, what is forecast to be left beside the law
  Stack simulated;                 ///< the same with the valve's own moves simulated too; empty where `verified` is 0
  Eigen::VectorXd simulated_at;    ///< the vector of that simulation
  int simulations = 0;
};

/// The parameters of one law that explain most of a linearised fit's residual.
///
/// Every start is tried; the best goes through a few bounded Gauss-Newton steps in the projected metric, the law itself
/// always simulated, the valve around it linear. `law.start` is ignored, `starts` holds vectors of the law's parameters
/// (own ones of every recording behind the shared ones).
///
/// worthwhile  a law whose best start would lower the cost by less is not refined: it is out of the race
/// options   of the fit behind `fit`; the law is appended behind its laws
/// returns   empty where no start has any effect on these recordings: the data do not excite it
std::optional<LawFit> search_law(const LinearisedValve& fit, const ValveFitOptions& options, const LawInFit& law,
                                 const std::vector<std::vector<double>>& starts, int most_steps, double worthwhile);

/// Samples over which a law's signature changes slowest: the period of a tone, the longest recording for a drift that
/// all of them share, 0 for laws that act where the input moves or in one recording.
Eigen::Index slowest_rows(const ValveFitProblem& problem, const LawInFit& law, const std::vector<double>& parameters);

/// The size farthest from none that the data do not exclude with 95 %: where the cost, everything the valve can absorb
/// taken off, is 2.71 noise variances above its least (one-sided; Wilks, Ann. Math. Statist. 9 (1938) 60), the samples'
/// part of it tempered, `size_sd` of good valves added in quadrature.
///
/// inflation  of the noise by its colour, ≥ 1
/// returns    empty where no size within the law's bounds is excluded
std::optional<double> upper_limit95(const LinearisedValve& fit, const ValveFitOptions& options, const LawFit& law,
                                    double inflation, double size_sd);

}  // namespace valvetriage
