#pragma once

#include <optional>

#include "core/discrepancy/discrepancy.h"
#include "core/discrepancy/linearised_valve.h"
#include "core/discrepancy/valve_explanation.h"

namespace valvetriage {

/// A better account of what a law explains, of something that no cause stands for: one of the valve's own parameters
/// beyond the range of good valves, or more air in the fluid than good valves share. A law is searched while these are
/// held near good valves', so that of two that look alike the law is all that is free to move.
///
/// Better: the law leaves it five standard errors and more, a fit with it instead of the law is better by as much, and
/// beside that not much is left for the law to do. A cause that is the same thing, a delay or a lag, leaves nothing to
/// it.
///
/// with       at the explanation
/// law        of the explanation, the one in doubt
/// others     the explanation without that law, at its minimum
/// inflation  of the noise, as if it were white
/// returns    nothing without a reference, or where the law stands
/// Cost       one linearisation, nine free runs of each recording; fits, a second or so of each, only of what the law
///            leaves unsaid
std::optional<Finding> unnamed_account(const Explanation& explanation, const LinearisedValve& with, std::size_t law,
                                       const Explanation& others, double inflation);

}  // namespace valvetriage
