#pragma once

#include <ctime>

namespace valvetriage::bench {

/// Processor time of this thread [s]: what other programs do meanwhile does not count.
inline double processor_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

}  // namespace valvetriage::bench
