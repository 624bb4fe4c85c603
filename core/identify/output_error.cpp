#include "core/identify/output_error.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/identify/arx.h"
#include "core/identify/output_error_search.h"

namespace valvetriage {
namespace {

constexpr int kFinalIterations = 8;

}  // namespace

std::string to_string(Termination termination) {
  switch (termination) {
    case Termination::kConverged:
      return "converged";
    case Termination::kNoDescent:
      return "no_descent";
    case Termination::kIterationLimit:
      return "iteration_limit";
    case Termination::kNotExcited:
      return "not_excited";
  }
  return "unknown";
}

Result<OutputErrorFit> fit_output_error(std::span<const Recording* const> recordings,
                                        const OutputErrorStructure& structure, const OutputErrorOptions& options) {
  if (const auto checked = check_structure(structure); !checked) return tl::unexpected(checked.error());
  const auto problem = OutputErrorProblem::create(recordings, options.offsets);
  if (!problem) return tl::unexpected(problem.error());
  if (const auto enough = problem->check_samples(structure); !enough) return tl::unexpected(enough.error());

  std::vector<Start> starts;
  if (const auto arx = fit_arx(recordings, structure)) {
    starts.push_back(start_from_poles("arx", z_roots(in_powers_of_difference(arx->coefficients.a)), structure.order,
                                      problem->limits()));
  }
  for (const TransferFunction& given : options.starts) {
    starts.push_back(start_from_poles("given", given.poles, structure.order, problem->limits()));
  }
  const RowSets search_rows = problem->rows(options.max_search_rows);
  FitCandidate best = search(*problem, structure, search_rows, std::move(starts));
  best = refine(*problem, search_rows, std::move(best), options.max_iterations, options.tolerance);
  // At the optimum of the thinned rows, that of all is a step or two away.
  const RowSets all_rows = problem->rows(std::numeric_limits<std::size_t>::max());
  const int iterations = best.iterations;
  best = refine(*problem, all_rows, evaluate(*problem, structure, all_rows, {best.start, best.sections}),
                kFinalIterations, options.tolerance);
  best.iterations += iterations;
  return describe(*problem, best);
}

Result<FreeRun> free_run(std::span<const Recording* const> recordings, const RationalCoefficients& dynamics) {
  const auto problem = OutputErrorProblem::create(recordings, OffsetSharing::kPerRecording);
  if (!problem) return tl::unexpected(problem.error());
  if (dynamics.b.size() > dynamics.a.size()) return fail("improper", "the model has more zeros than poles");
  auto poles = z_roots(in_powers_of_difference(dynamics.a));
  poles.resize(dynamics.a.size() - 1, 0.0);
  const bool stable = std::all_of(poles.begin(), poles.end(), [](const auto& pole) { return std::abs(pole) < 1; });
  if (!stable) return fail("unstable", "the model has a pole outside the unit circle: a free run of it means nothing");
  return run_of(*problem, candidate_of(*problem, dynamics, poles));
}

}  // namespace valvetriage
