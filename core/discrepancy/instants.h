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

/// Whether a law at an instant may act from a move of the input on, as far as the data tell, though its recording rests
/// most of the time. A loose contact knows nothing of the input; a memory changes its state where that moves alone.
///
/// law        of the explanation, in one recording
/// inflation  of the noise (`noise_inflation`)
/// Cost       one simulation of the valve for each move of the recording
bool may_begin_with_input(const Explanation& explanation, std::size_t law, double inflation);

}  // namespace valvetriage
