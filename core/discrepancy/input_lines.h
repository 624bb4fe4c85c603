#pragma once

#include <vector>

#include "core/discrepancy/discrepancy.h"
#include "core/discrepancy/linearised_valve.h"

namespace valvetriage {

/// Recordings whose logged input has been rid of lines that the valve never saw.
struct CleanInputs {
  std::vector<Recording> recordings;  ///< empty: there was nothing to take off
  std::vector<Finding> findings;      ///< one per line
};

/// Takes off the logged input what ripple and dither leave in it: a current clock far above half the sampling rate
/// appears in the log at an alias of its frequency, the simulation follows that alias, and the valve does not.
///
/// A line is looked for where the residual has one and where the input at rest has one. It is taken off where the input
/// has it in at least two recordings that rest or go straight (one, where there is only one) at the 1e-4 level and the
/// simulation errs less without it. How much of it the output does not follow is told where the input moves, for there
/// no loop hides it: all of a ripple, nothing of a line that the valve follows, which stays.
///
/// Where fewer rest, sweeps and multisines tell: the line which the residual shows as one that the output does not
/// follow, by five standard errors, must be the one that the log has, in amplitude and phase, where a sweep is far
/// slower or faster or between the lines of a periodic input.
///
/// fit      of the recordings as logged
/// Source   aliasing: any text on sampling; the test is the F test of a sine and a cosine beside piecewise straight
/// lines
CleanInputs without_aliased_lines(const LinearisedValve& fit, const ValveFitOptions& options);

/// Whether the logged input has a line at this frequency; see without_aliased_lines.
bool stands_in_input(const ValveFitProblem& problem, double frequency_hz);

}  // namespace valvetriage
