#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "core/model/model.h"
#include "core/model/reference.h"
#include "core/recording/recording.h"
#include "core/residual/residual_signature.h"

namespace valvetriage::report {

/// One valve's binned residuals by the test they are of: "step, 20.0 s"; of several alike the later ones carry a
/// number, in the order of their names.
using ValveResiduals = std::map<std::string, BinnedResidual>;

/// Runs of a recording: of a 20 s test at 200 Hz 60 samples each, a time constant or two.
inline constexpr std::size_t kResidualBins = 64;

/// What the model's free run leaves of one valve's recordings. A recording that cannot be simulated is left out.
///
/// known  as in free_run
/// Cost   a simulation per recording
ValveResiduals valve_residuals(std::vector<Recording> recordings, const Model& model,
                               std::span<const KnownTest> known = {});

}  // namespace valvetriage::report
