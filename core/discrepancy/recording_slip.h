#pragma once

#include <optional>

#include "core/discrepancy/valve_conclusion.h"

namespace valvetriage {

/// What the pressures of a fitted valve say of the recordings rather than of the valve, whatever law acts in it, so
/// that nothing needs to be searched:
///
/// gauge  the pressure is one value throughout each recording, to the last digit: no law is told from another by a
///        reading that never moves, be it the gauge's fault or the valve's
/// unit   the pressures are those of good valves on the same inputs times what one unit of pressure is in another,
///        within a good valve's spread of gain
///
/// returns  the finding, in words that say what to check; empty for everything a valve can do
/// Cost     three simulations of the session
std::optional<Finding> slip_of_gauge_or_unit(const Explanation& baseline);

/// The same of a pressure whose sign is swapped: the map of the explanation falls as good valves' map rises, and one
/// that falls nowhere would miss the pressures by more than their noise. No law turns a valve round, so whatever was
/// found beside such a map is no cause. Told once laws were searched: a delay may have made the map of the baseline
/// fall.
std::optional<Finding> slip_of_sign(const Explanation& explanation);

/// The conclusion for such recordings: `unexplained` for this reason, nothing named, nothing added to the baseline. No
/// figure of the gain exists: what a falling map simulates cannot be handed out.
ValveDiagnosis conclude_slip(const Explanation& baseline, Finding slip);

}  // namespace valvetriage
