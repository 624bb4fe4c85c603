#pragma once

#include <string>
#include <vector>

#include "core/discrepancy/discrepancy.h"
#include "core/discrepancy/machine_search.h"
#include "core/discrepancy/machine_sticking_loop.h"

namespace valvetriage {

/// What the held-out scores allow to say.
struct MachineVerdict {
  Conclusion conclusion = Conclusion::kNone;
  const MachineScore* winner = nullptr;  ///< null: nothing was added
  /// Per cause of the winner: causes that could stand in its place.
  std::vector<std::vector<std::string>> alternatives;
  std::vector<Candidate> candidates;  ///< with probabilities; rmse_heldout in scaled units
  double p_value = 1;                 ///< of the winner against the linear machine
};

/// The recordings from end to end, and the linear machine with its starts on them.
struct MachineRuns {
  const MachineData& data;
  const MachineFit& linear;
};

/// data       what was searched
/// noise_rms  irreducible noise, scaled units
/// feedback   the input follows the output: nothing is named, memory laws stay ambiguous
MachineVerdict conclude(const MachineSearch& search, const MachineData& data, const MachineRuns& runs, double noise_rms,
                        bool feedback);

/// The verdict where the winner, fitted again to every sample, has nothing left of the effect that its name says:
/// structure without a name.
MachineVerdict conclude_without_effect(const MachineVerdict& verdict, const MachineSearch& search,
                                       const MachineData& data);

/// The verdict where the loop itself tells that its valve sticks (machine_sticking_loop.h), whatever free runs tell:
/// `friction`, beside what else holds an input back. A regulated loop settles no name.
///
/// friction  the valve and the process behind it; must outlive the verdict
MachineVerdict conclude_sticking(MachineVerdict by_free_runs, const MachineScore& friction, const StickingLoop& loop);

}  // namespace valvetriage
