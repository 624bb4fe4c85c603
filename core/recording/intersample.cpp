#include "core/recording/intersample.h"

namespace valvetriage {

IntervalSignal input_between_samples(const Recording& recording) {
  const auto& u = recording.input.values;
  IntervalSignal signal{u, u};
  for (std::size_t i = 0; i + 1 < u.size(); ++i) signal.end[i] = u[i + 1];
  for (const Segment& segment : recording.segments) {
    if (segment.kind == SegmentKind::kStep && segment.begin > 0) {
      signal.end[segment.begin - 1] = signal.start[segment.begin - 1];
    }
  }
  return signal;
}

}  // namespace valvetriage
