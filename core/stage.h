#pragma once

#include <functional>
#include <string_view>

namespace valvetriage {

/// Told what a long computation is at: the share that is done (0 to 1, never falling, a guess of its time) and what
/// comes next, in words for a person. Called by the thread that computes; no result depends on it.
using StageReport = std::function<void(double done, std::string_view next)>;

inline void report_stage(const StageReport& report, double done, std::string_view next) {
  if (report) report(done, next);
}

/// For a part of a computation that takes the share between `from` and `to` of the whole.
inline StageReport report_part(const StageReport& whole, double from, double to) {
  if (!whole) return {};
  return [whole, from, to](double done, std::string_view next) { whole(from + (to - from) * done, next); };
}

}  // namespace valvetriage
