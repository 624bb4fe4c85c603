#pragma once

#include <string>

#include "core/discrepancy/discrepancy.h"
#include "server/wire/json_fields.h"

namespace valvetriage {

/// `discrepancy` of an analysis (schemas/analysis.schema.json). A figure that is not finite is
/// null.
Json to_json(const Discrepancy& discrepancy);

/// The same as part of a larger document; null reads back as NaN.
///
/// Errors  of the fields; `unknown_value` for a conclusion or a status that the contract does not know
Discrepancy discrepancy_from_json(JsonFields fields);

/// Names as the contract writes them.
std::string to_string(Conclusion conclusion);
std::string to_string(CandidateStatus status);

}  // namespace valvetriage
