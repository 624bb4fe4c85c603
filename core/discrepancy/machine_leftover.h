#pragma once

#include "core/discrepancy/machine_search.h"

namespace valvetriage {

/// How much of what a linear machine leaves answers the input in some way, and how far that is beyond chance.
struct LeftAnswer {
  double share = 0;  ///< of the residual's power, beyond what the same residual at other times has in the median
  /// The same over the most that the residual has at any of 361 other times. Noise with a memory reaches 1 about as
  /// often as its p-value of 1 in 362 says where it is short against the records, and 1.4 in 1 of 60 where it is not.
  double over_chance = 0;
};

/// Regresses the residual on the linear machine's states and input in short blocks. A gain or time constant that moves
/// answers the input in every block, each time otherwise, so that no law of the machine's signals takes it up; noise of
/// any memory does so by chance only. What chance does is seen on the residual itself, moved against the states along
/// the record (circular shifts keep both as they are and break only what joins them).
///
/// linear  with its starts on `data`; a machine that sets no input of its own: under feedback the input answers the
///         residual
/// blocks  over all records, at least two in each: many see quick changes, few see a change between few steps
/// Cost    O(shifts · rows · states), of at most 40,000 rows
LeftAnswer local_answer(const MachineData& data, const MachineFit& linear, std::size_t blocks);

/// The same with curves of the input and of the simulated output, plays of the input and speeds, each at once and
/// behind lags, regressed on over all records: what a map, a memory or a damping of any shape leaves, though no law of
/// the vocabulary may fit it.
LeftAnswer curved_answer(const MachineData& data, const MachineFit& linear);

/// Share of the power of what a linear machine leaves, foretold as well as its own past and any linear machine can,
/// that comes in bursts beyond six of its usual deviations. Noise of whatever colour has none; a reading that jumps, a
/// relay that switches, a slip, a machine that changes has. 0 where there is too little to tell.
///
/// Cost    O(rows · (order of the noise + states)²)
double share_of_bursts(const MachineData& data, const MachineFit& linear);

}  // namespace valvetriage
