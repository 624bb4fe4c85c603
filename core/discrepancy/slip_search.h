#pragma once

#include <vector>

#include "core/discrepancy/valve_explanation.h"

namespace valvetriage {

/// Whether a law makes the spool stick which moves freely without it.
bool makes_stick(const LawInFit& law, const Explanation& beside);

/// Where the joint fit of a valve whose spool sticks and slips may begin.
///
/// A slip that comes a little early moves every later one, so the free run's cost has a valley beside each right number
/// of slips, and a fit from anywhere ends in one of them. One slip ahead of the data, each slip beginning where the
/// measured spool rested, the cost is smooth: dry friction is laid on a valve over a grid of its parameters, and the
/// best points are fitted together with the valve so, each recording weighed by what is left of it. Where slips on slow
/// ramps show breakaway and kinetic force, those are tried beside the grid. The law alone is then searched in free
/// runs.
///
/// law      that makes the spool stick
/// place    of the valve, as Explanation::v; a good valve's, where the fit beside has bent towards the friction
/// closest  what leaves least so far, by free runs
/// Returns the best first; none where no friction one slip ahead leaves as little as `closest` does, or hardly more
std::vector<JointStart> slip_starts(const Explanation& beside, const LawInFit& law, const Eigen::VectorXd& place,
                                    const Explanation& closest);

}  // namespace valvetriage
