#pragma once

#include <map>
#include <string>
#include <string_view>

#include "core/residual/residual_signature.h"
#include "core/result.h"

namespace valvetriage {

/// Binned residuals by test as they are stored, {"step, 20.0 s": {"value": [...], "time_s": [...], "white_sd": 0.05}}:
/// to 5 significant digits, a bin without a valid sample as null.
std::string residuals_to_json(const std::map<std::string, BinnedResidual>& residuals);

/// Errors  those of parse_json; `wrong_type`, `missing_field`, `out_of_range` where it is not what residuals_to_json
/// gave
Result<std::map<std::string, BinnedResidual>> residuals_from_json(std::string_view text);

}  // namespace valvetriage
