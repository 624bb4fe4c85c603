#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "core/recording/recording.h"
#include "core/result.h"
#include "server/jobs/file_to_read.h"

namespace valvetriage {

/// Files that this process may not open itself (MAT) or need not parse as a whole, read by a child that may die of
/// them.

/// The hidden verb of the binary that reads one file: `valvetriage reading-child`.
inline constexpr std::string_view kReadingVerb = "reading-child";

/// Everything in it, or only what it says of itself, without its samples.
enum class WhatToRead { kAll, kLabels };

/// Starts a child, which reads the file, and takes over what it found.
///
/// keep_going  asked several times a second; once it says no the child is ended
/// command     what reads; empty: this binary with the verb `reading-child`
/// Errors      those of reading, with the position; `cannot_start_child`, `reading_timeout`, `draining` (it was ended),
///             which may pass; `unreadable` where the child gave no answer
/// Cost        blocks, 30 s at most, of which 20 s of processor; twice the parsed numbers
Result<RawRecording> read_in_child(
    const FileToRead& file, WhatToRead what = WhatToRead::kAll, std::function<bool()> keep_going = [] { return true; },
    std::vector<std::string> command = {});

/// The child's whole life: the file to read from standard input, what it holds as lines of JSON on standard output. The
/// exit status: 0 when an answer was given, whatever it was.
int run_reading_child();

}  // namespace valvetriage
