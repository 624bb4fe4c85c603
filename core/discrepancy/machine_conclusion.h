#pragma once

#include <string>
#include <vector>

#include "core/discrepancy/discrepancy.h"
#include "core/discrepancy/machine_search.h"

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

/// noise_rms  irreducible noise, scaled units
/// feedback   the input follows the output: nothing is named, memory laws stay ambiguous
MachineVerdict conclude(const MachineSearch& search, const MachineData& data, double noise_rms, bool feedback);

}  // namespace valvetriage
