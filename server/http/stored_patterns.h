#pragma once

#include "server/http/lot_history.h"
#include "server/http/lot_patterns.h"
#include "server/http/service.h"

namespace valvetriage::http {

/// Groups of a lot's unexplained valves that leave the same residual over time.
struct StoredPatterns {
  std::size_t unexplained = 0;                 ///< valves of the lot
  std::vector<const SubmissionRow*> compared;  ///< of them, newest first: see limits.h
  std::size_t good_valves = 0;                 ///< of the lot, whose residual counts as usual
  std::vector<LotPattern> groups;              ///< members are indices into `compared`

  /// Those that no group has taken.
  std::vector<const SubmissionRow*> alone() const;
};

/// history  has to outlive the result
/// Cost     O(v) reads and the clustering; a simulation per recording where an analysis kept no residuals
Result<StoredPatterns> stored_patterns(Service& service, const LotHistory& history);

}  // namespace valvetriage::http
