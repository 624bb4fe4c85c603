#pragma once

#include <vector>

#include "core/discrepancy/discrepancy.h"
#include "core/discrepancy/law_search.h"

namespace valvetriage {

/// Entry of a law that acts in one recording from an instant on: that instant [s].
inline constexpr std::size_t kInstantOf = 0;

/// One way in which a cause may act in a session: everywhere, in one recording, through one side channel.
struct LawVariant {
  LawInFit law;
  std::vector<std::vector<double>> starts;  ///< shared parameters, then each recording's own
};

/// Every variant of every cause that a session could show beside a fitted valve.
struct ValveCatalogue {
  std::vector<LawVariant> variants;
  std::vector<Candidate> untestable;  ///< with status and reason
};

ValveCatalogue valve_catalogue(const LinearisedValve& fit, const ValveFitOptions& options);

}  // namespace valvetriage
