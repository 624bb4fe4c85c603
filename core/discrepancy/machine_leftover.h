#pragma once

#include "core/discrepancy/machine_search.h"

namespace valvetriage {

/// How much of what a linear machine leaves follows its own states for a while, and whether chance does that too.
struct LocalAnswer {
  double share = 0;    ///< of the residual's power, beyond what the same residual at other times has
  double p_value = 1;  ///< of that much by a residual that knows nothing of the input
};

/// Regresses the residual on the linear machine's states and input in short blocks. A gain or time constant that moves
/// answers the input in every block, each time otherwise, so that no law of the machine's signals takes it up; noise of
/// any memory does so by chance only. What chance does is seen on the residual itself, moved against the states along
/// the record (circular shifts keep both as they are and break only what joins them).
///
/// Only for a machine that sets no input of its own: under feedback the input answers the residual.
/// Cost  O(shifts · n · states)
LocalAnswer local_answer(const MachineData& data, const MachineFit& linear);

}  // namespace valvetriage
