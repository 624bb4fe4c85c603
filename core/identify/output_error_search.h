#pragma once

#include <string>
#include <vector>

#include "core/identify/output_error_problem.h"

namespace valvetriage {

/// A point of the search: sections, everything linear at its optimum, and the price.
struct FitCandidate {
  OutputErrorStructure structure;
  std::vector<Section> sections;
  OutputErrorProblem::Solution solution;
  double cost = 0;  ///< squared error times (1 + slow-mode penalty / rows)
  std::string start;
  Termination termination = Termination::kIterationLimit;
  int iterations = 0;
};

struct Start {
  std::string name;
  std::vector<Section> sections;
};

/// The candidate at given sections.
FitCandidate evaluate(const OutputErrorProblem& problem, const OutputErrorStructure& structure, const RowSets& rows,
                      const Start& start);

/// Bounded Levenberg-Marquardt on the sections' logarithms from a candidate.
FitCandidate refine(const OutputErrorProblem& problem, const RowSets& rows, FitCandidate candidate, int max_iterations,
                    double tolerance);

/// Best candidate out of the given starts and Steiglitz-McBride iterations from several bandwidths.
FitCandidate search(const OutputErrorProblem& problem, const OutputErrorStructure& structure, const RowSets& rows,
                    std::vector<Start> starts);

/// The poles of a z-domain transfer function as a start of the wanted order (filled up with fast poles, or without the
/// fastest).
Start start_from_poles(std::string name, std::span<const std::complex<double>> poles, int order,
                       const SectionLimits& limits);

/// Its free run over every sample, and how well that fits.
FreeRun run_of(const OutputErrorProblem& problem, const FitCandidate& candidate);
/// Given stable dynamics as a candidate, each recording's initial state and offset fitted to it.
FitCandidate candidate_of(const OutputErrorProblem& problem, const RationalCoefficients& dynamics,
                          std::span<const std::complex<double>> poles);
/// Everything a user gets to see about a candidate.
OutputErrorFit describe(const OutputErrorProblem& problem, const FitCandidate& candidate);

}  // namespace valvetriage
