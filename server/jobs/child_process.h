#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace valvetriage {

/// What one child may use. Each bound ends the child alone.
///
/// memory_bytes     address space: one recording of ten million rows needs 3 GB, a usual session 60 MB
/// cpu_s            processor time
/// wall_ms          from start to end
/// answer_bytes     of standard output, the result; standard error is cut at `messages_bytes`
struct ChildLimits {
  std::int64_t memory_bytes = std::int64_t{4} << 30;
  std::int64_t cpu_s = 600;
  std::int64_t wall_ms = 900'000;
  std::size_t answer_bytes = std::size_t{64} << 20;
  std::size_t messages_bytes = 16 << 10;
};

/// How a child ended.
///
/// kExited    by itself; `status` is its exit status
/// kSignal    killed by `status`
/// kTimeout   wall or processor time was up
/// kResource  it asked for more memory or output than it may have
/// kStopped   we stopped it
enum class ChildEnd { kExited, kSignal, kTimeout, kResource, kStopped };

struct ChildOutcome {
  ChildEnd end = ChildEnd::kExited;
  int status = 0;
  std::string messages;  ///< the last of its standard error
};

/// on_line     each line of standard output, without its end
/// keep_going  asked about every 100 ms; false kills the child
struct ChildWatch {
  std::function<void(std::string_view line)> on_line;
  std::function<bool()> keep_going;
};

/// Runs `command` (an absolute path and its arguments) with `input` on standard input until it ends, in a process of
/// its own with nothing else open: no core file, no file may grow, the limits above; it dies when the thread that
/// called dies.
///
/// Errors  `cannot_start_child`
/// Cost    blocks; one thread per child
Result<ChildOutcome> run_child_process(const std::vector<std::string>& command, std::string_view input,
                                       const ChildLimits& limits, const ChildWatch& watch);

}  // namespace valvetriage
