#pragma once

#include <optional>

#include "core/discrepancy/valve_explanation.h"

namespace valvetriage {

/// Where in one recording the gain of what is measured over what is simulated changes most: every instant is tried,
/// with a gain before it and a gain behind it, so that neither a valve that has bent half way towards the change nor a
/// local valley of the cost hides it. Bai, Econometric Theory 13 (1997) 315.
///
/// beside  without the law
/// law     an abrupt change of gain in one recording, its bounds those of the instants
/// place   of the valve, as Explanation::v
/// Returns nothing where the recording shows no gain on either side of any instant
/// Cost    one simulation of the recording
std::optional<JointStart> change_of_gain(const Explanation& beside, const LawInFit& law, const Eigen::VectorXd& place);

/// The joint fit of a law at an instant, begun again at the instant that its own valve shows until that stays: in free
/// runs the cost has a valley beside every sample or two. `fitted` is `beside` with the law.
Explanation at_its_instant(Explanation fitted, const Explanation& beside, const LawFit& law, int most_iterations);

}  // namespace valvetriage
