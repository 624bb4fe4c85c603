#pragma once

#include "core/discrepancy/machine_leftover.h"

namespace valvetriage {

/// Whether a limit is passed by the signal that enters it, often enough to be seen: a limit out of reach is a curve at
/// most, and the name of a level that nothing ever came to would be a guess.
bool is_reached(const MachineData& data, const MachineFit& fit, std::size_t limit);

/// Whether a dead band lies at an end of the input that is not about its zero: but for one sample in twenty the signal
/// leaves it on one side alone. What does not answer there and does not begin again has stopped.
///
/// input_zero  scaled units
bool is_at_far_end(const MachineData& data, const MachineFit& fit, std::size_t band, double input_zero);

/// False where the limits of a chain bend rather than stop: one is passed and yet follows more than a tenth of what
/// enters it, or two are rounded so much that they leave no straight way between them. True for a chain without limits.
bool has_true_stops(const MachineData& data, const MachineFit& fit);

/// Share of the output's power over all records that is not there where the input stays at its first value: what a
/// machine that only rings from its start does without.
double share_driven(const MachineData& data, const MachineFit& fit);

/// Share of what a fit leaves that another map in the place of one of its static laws (limits, dead band, curve,
/// magnitude) would take up: straight pieces between nine nodes over what enters the law, through everything behind it.
/// A law of the right shape leaves nothing there but chance. Of several laws the one that leaves most; none where the
/// chain has no static law. Cost O(n · nodes · (blocks + shifts))
LeftAnswer answer_by_shape(const MachineData& data, const MachineFit& fit);

}  // namespace valvetriage
