#pragma once

#include "server/http/lot_history.h"
#include "server/http/lot_patterns.h"
#include "server/http/service.h"

namespace valvetriage::http {

/// Groups of a lot's unexplained valves that leave the same residual over time.
struct StoredPatterns {
  std::size_t unexplained = 0;                 ///< valves of the lot
  std::vector<const SubmissionRow*> compared;  ///< the newest kMaxPatternValves of them, newest first
  std::size_t good_valves = 0;                 ///< of the lot, whose residual counts as usual
  std::vector<LotPattern> groups;              ///< members are indices into `compared`

  /// Those that no group has taken.
  std::vector<const SubmissionRow*> alone() const;
};

/// history  has to outlive the result
/// Cost     a simulation per recording the first time, kept in the service's residual cache
Result<StoredPatterns> stored_patterns(Service& service, const LotHistory& history);

}  // namespace valvetriage::http
