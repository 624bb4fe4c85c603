#pragma once

#include <string>

#include "core/model/model.h"

namespace valvetriage {

/// A model as one self-contained C99 file: no allocation, nothing but <math.h>, the state in a struct of the caller's.
///
///   void   valvetriage_start(valvetriage_model *m, double input, double input_noise);
///   double valvetriage_step(valvetriage_model *m, double input, int is_step, double side);
///
/// One step per sample gives what `simulate` gives from steady state at the first input, to rounding. `is_step` tells
/// that a command was held until this sample, `side` is the side channel. Compiled with VALVETRIAGE_MAIN the file is a
/// filter: `input is_step side` per line in, the output per line out.
///
/// A machine, a chain of blocks of its own, is told by machine_c.h.
/// A linear model has no range of its own, so that its saturation has a sharp corner here; `intermittent` acts in every
/// run.
///
/// sample_period_s  > 0; the dynamics are sampled for it, delay to the fraction of a sample
/// Errors  as `simulate_extended`; `unstable`; `needs_range` for a law on a linear model that is told in shares of the
///         output's range; `too_many` for a second side channel
Result<std::string> to_c(const Model& model, double sample_period_s);

}  // namespace valvetriage
