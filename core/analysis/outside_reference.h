#pragma once

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

}  // namespace valvetriage
