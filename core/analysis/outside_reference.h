#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/model/reference.h"
#include "core/recording/quality.h"

namespace valvetriage {

/// Whether an input is beyond what the reference saw, and beyond the reach of its end knots.
bool outside_reference(const Reference& reference, double input_a);

/// Where a recording's input is outside the reference, in time's order; code `outside_reference`. Stretches that noise
/// interrupts for fewer than ten samples are one.
///
/// Cost  O(n)
std::vector<QualityPlace> outside_reference_places(const Recording& recording, const Reference& reference);

/// Of recordings that lie outside the reference throughout: where its inputs lie, where theirs, and the slip that this
/// looks like, a wrong sign, swapped columns or a wrong unit.
///
/// Cost  O(n)
std::string outside_throughout(std::span<const Recording> recordings, const Reference& reference);

/// Why recordings cannot be compared with a reference; empty where they can.
///
/// recordings  as they came
/// kept        the same, with what the reference cannot be compared with marked not valid; less than `least_s` of it
///             in all says nothing about the valve
/// Cost        O(n)
std::string not_comparable(std::span<const Recording> recordings, std::span<const Recording> kept,
                           const Reference& reference, double least_s);

}  // namespace valvetriage
