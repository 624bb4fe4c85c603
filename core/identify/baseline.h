#pragma once

#include <span>
#include <vector>

#include "core/identify/identification.h"

namespace valvetriage {

/// A linear baseline fitted on the very recordings it is to simulate.
struct FittedBaseline {
  Model model;  ///< kind "linear"
  Identification identification;
  std::vector<std::vector<double>> simulated;  ///< free run per recording and grid sample; empty where unstable
};

/// Baseline `self`: output-error fit around one affine operating point, order and delay chosen by held-out free run.
///
/// Errors  as identify
/// Cost    about a second for 24,000 samples
Result<FittedBaseline> fit_self_baseline(std::span<const Recording> recordings);

/// Baseline `paper`: the paper's recursion on increments (Eqs 7 to 15, c1 = 0, nothing forgotten), order 7 as Eqs 18
/// and 19. Its operating point comes from the recordings, for increments have none. It may well be unstable; that is a
/// value (`identification.stable`), and then there is no simulation.
///
/// Errors  as RecursiveLeastSquares and free_run
Result<FittedBaseline> fit_paper_baseline(std::span<const Recording> recordings);

}  // namespace valvetriage
