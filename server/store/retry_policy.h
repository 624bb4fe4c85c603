#pragma once

#include <cstdint>

#include "server/store/store.h"

namespace valvetriage {

/// Starts of one job before a passing fault is taken for a lasting one: with the backoff below, about four minutes.
inline constexpr int kMaxAttempts = 8;
/// Deaths of a job's child before its input is quarantined.
inline constexpr int kMaxCrashes = 3;
/// Wall-time overruns before the job is given up: one could have been a busy machine.
inline constexpr int kMaxTimeouts = 2;
inline constexpr std::int64_t kFirstBackoffMs = 1'000;
inline constexpr std::int64_t kLongestBackoffMs = 600'000;

/// How often a job was tried so far, the attempt that just ended included.
struct AttemptCounts {
  int attempts = 0;
  int crashes = 0;
  int timeouts = 0;
};

/// delay_ms  how long a job that is queued again has to wait
struct NextStep {
  JobState state = JobState::kQueued;
  std::int64_t delay_ms = 0;
  AttemptCounts counts;
};

/// What becomes of a job whose attempt ended without a result. `before`: the counts before this end is taken into them.
NextStep next_step(AttemptEnd end, AttemptCounts before);

}  // namespace valvetriage
