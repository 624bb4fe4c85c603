#pragma once

#include "core/recording/recording.h"

namespace valvetriage {

/// From parsed columns to a Recording: time base checked and made uniform, quality judged, segments found, test
/// inferred.
///
/// Errors  time that does not increase, not enough samples, a constant input, values not finite
/// Cost    O(n), grows linearly; a pure function of its argument
Result<Recording> prepare_recording(RawRecording raw, const ColumnMapping& mapping);

}  // namespace valvetriage
