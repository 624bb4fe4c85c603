#pragma once

#include "server/http/lot_history.h"
#include "server/report/cause_sizes.h"
#include "server/store/store.h"

namespace valvetriage::http {

/// Parameters of the settled causes over a lot's valves, each by its newest result. What every recording has its own of
/// says nothing about the valve and is left out.
///
/// Cost  reads the analyses of the newest kMaxNamedValves valves with a settled cause
Result<report::LotSizes> lot_sizes(Store& store, const LotHistory& history);

}  // namespace valvetriage::http
