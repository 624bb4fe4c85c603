#include "server/store/retry_policy.h"

#include <algorithm>

namespace valvetriage {
namespace {

std::int64_t backoff_ms(int attempts) {
  const int doublings = std::clamp(attempts - 1, 0, 20);
  return std::min(kFirstBackoffMs << doublings, kLongestBackoffMs);
}

NextStep again_unless(bool given_up, JobState given_up_state, AttemptCounts counts) {
  if (given_up) return {given_up_state, 0, counts};
  return {JobState::kQueued, backoff_ms(counts.attempts), counts};
}

}  // namespace

NextStep next_step(AttemptEnd end, AttemptCounts before) {
  AttemptCounts counts = before;
  switch (end) {
    case AttemptEnd::kRejected:
      return {JobState::kRejected, 0, counts};
    case AttemptEnd::kFailed:
      return {JobState::kFailed, 0, counts};
    case AttemptEnd::kReturned:
      counts.attempts = std::max(0, counts.attempts - 1);
      return {JobState::kQueued, 0, counts};
    case AttemptEnd::kFault:
      return again_unless(counts.attempts >= kMaxAttempts, JobState::kFailed, counts);
    case AttemptEnd::kTimeout:
      ++counts.timeouts;
      return again_unless(counts.timeouts >= kMaxTimeouts, JobState::kFailed, counts);
    case AttemptEnd::kCrash:
      ++counts.crashes;
      return again_unless(counts.crashes >= kMaxCrashes, JobState::kPoisoned, counts);
  }
  return {JobState::kFailed, 0, counts};
}

}  // namespace valvetriage
