#pragma once

#include <span>

#include "core/analysis/analysis.h"
#include "server/wire/json.h"

namespace valvetriage {

/// One entry of an analysis's `frequency_response`.
///
/// recordings  of the analysis: an entry names its own by their sha256
Json to_json(const FrequencyResult& result, std::span<const RecordingSummary> recordings);

}  // namespace valvetriage
