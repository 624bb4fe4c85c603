#pragma once

#include <span>
#include <vector>

#include "core/discrepancy/valve_contest.h"

namespace valvetriage {

/// How one law of an explanation won its place.
struct WonPlace {
  std::vector<Ranked> ranked;
  std::vector<Explanation> rivals;  ///< those that were fitted in its place
  double p_value = 1;
};

/// What a search for causes ended with.
struct SearchedValve {
  const Explanation& baseline;
  const Explanation& explanation;
  const std::vector<WonPlace>& places;  ///< one per law of the explanation
  const Contest& first;                 ///< beside the baseline
  std::span<const UnseenCause> unseen;  ///< beside the explanation
};

/// The contract's account of it: conclusion, findings, causes with their rivals, candidates with upper limits, gain,
/// and the test that would settle what is left open.
ValveDiagnosis conclude(const SearchedValve& searched, const ValveDiagnosisOptions& options);

/// The same where a slip of the recordings leaves nothing to search (recording_slip.h).
ValveDiagnosis conclude_at_once(const Explanation& baseline, Finding slip);

}  // namespace valvetriage
