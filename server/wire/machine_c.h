#pragma once

#include <string>

#include "core/model/model.h"

namespace valvetriage {

/// A model of kind `machine` as one C99 file: `to_c` (model_c.h) for a chain of blocks.
///
/// The steps give what `run_machine` gives from steady state at the first input, to rounding. Where means over
/// intervals enter the machine, what enters at a sample is known at the next one only: a step then returns the output
/// of the sample before, the first step that of rest. `is_step` counts there alone. `side` is the channel's value as it
/// was recorded; a block subtracts its own `centre`.
///
/// model   with a `machine`
/// Errors  `machine_malformed`; `own_period` for a sample period that is not the machine's; `too_many` for a second
///         side channel
Result<std::string> machine_to_c(const Model& model, double sample_period_s);

}  // namespace valvetriage
