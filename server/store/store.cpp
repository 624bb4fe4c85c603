#include "server/store/store.h"

#include <utility>

namespace valvetriage {
namespace {

constexpr std::array<std::pair<JobState, std::string_view>, kJobStates.size()> kStateNames = {{
    {JobState::kQueued, "queued"},
    {JobState::kRunning, "running"},
    {JobState::kDone, "done"},
    {JobState::kFailed, "failed"},
    {JobState::kRejected, "rejected"},
    {JobState::kPoisoned, "poisoned"},
    {JobState::kCancelled, "cancelled"},
}};

}  // namespace

std::string_view to_text(JobState state) {
  return kStateNames[static_cast<std::size_t>(state)].second;
}

std::optional<JobState> job_state_from(std::string_view text) {
  for (const auto& [state, name] : kStateNames) {
    if (name == text) return state;
  }
  return std::nullopt;
}

}  // namespace valvetriage
