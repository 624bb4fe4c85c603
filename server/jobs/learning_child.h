#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "core/model/reference.h"
#include "core/result.h"
#include "server/jobs/file_to_read.h"

namespace valvetriage {

/// References learned by a child: it takes seconds a valve, and neither a file nor a fit that goes wrong may reach the
/// server.

/// The hidden verb of the binary that learns one reference: `valvetriage learning-child`.
inline constexpr std::string_view kLearningVerb = "learning-child";

/// files  with the options of their newest jobs
struct GoodValve {
  std::string serial{};
  std::vector<FileToRead> files{};
};

/// Starts a child, which reads the valves' files and learns what they have in common.
///
/// keep_going  asked about every 100 ms; false kills the child
/// Errors      those of reading and of learn_reference; `cannot_start_child`; `learning_failed` where the child gave no
///             answer
/// Cost        blocks, an hour at most; seconds a valve
Result<Reference> learn_in_child(const std::vector<GoodValve>& valves, const std::string& valve_type,
                                 std::function<bool()> keep_going);

/// The child's whole life: what to learn from on standard input, the reference on standard output. The exit status: 0
/// when an answer was given, whatever it was.
int run_learning_child();

}  // namespace valvetriage
