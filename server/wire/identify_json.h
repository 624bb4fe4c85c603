#pragma once

#include "core/identify/identification.h"
#include "core/identify/rls.h"
#include "server/wire/json.h"

namespace valvetriage {

/// The result of `identify --json` (schemas/identify.schema.json), then what `simulate --model` and
/// a reader need beyond it: units, operating point, static gain, coefficients with standard errors, step figures,
/// notes.
Json to_json(const Identification& identification);

/// One line of `identify - --follow --json`: the estimate by name with its covariance, both null while unknown.
Json estimate_json(const RecursiveLeastSquares& rls, std::size_t row, double time_s);

}  // namespace valvetriage
