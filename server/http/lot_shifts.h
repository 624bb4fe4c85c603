#pragma once

#include "server/http/lot_history.h"
#include "server/report/lot_shift.h"
#include "server/store/store.h"

namespace valvetriage::http {

/// What the valves of a lot share beside their own causes: every figure of their own fits against the good valves of
/// the reference that most of them were compared with. Valves with a settled cause and those that are unexplained take
/// no part: their fits are bent by what is wrong with them, and what is wrong is told elsewhere.
///
/// Cost  reads the analyses of the newest kMaxShiftValves of them
Result<report::LotShifts> lot_shifts(Store& store, const LotHistory& history);

}  // namespace valvetriage::http
