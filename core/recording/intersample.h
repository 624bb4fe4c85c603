#pragma once

#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// A signal that is known between its samples: over sample interval i it goes straight from start[i] to end[i].
/// end[i] == start[i] is a held command (zero order), end[i] == start[i + 1] a ramp.
struct IntervalSignal {
  std::vector<double> start;
  std::vector<double> end;
};

/// The input between its samples: a step command is held until the sample at which it first has its new value,
/// everything else is linear. Half a sample of error here is 8 times the noise at a step edge.
IntervalSignal input_between_samples(const Recording& recording);

}  // namespace valvetriage
