#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "core/recording/recording.h"
#include "core/result.h"

namespace valvetriage {

/// Files that this process may not open itself (MAT) or need not parse as a whole, read by a child that may die of
/// them.

/// The hidden verb of the binary that reads one file: `valvetriage reading-child`.
inline constexpr std::string_view kReadingVerb = "reading-child";

/// options_json  as the upload asked: column mapping, sample rate
/// labels_only   what it says of itself, without its samples
struct FileToRead {
  std::string path{};
  std::string name{};
  std::string options_json = "{}";
  bool labels_only = false;
};

/// The column mapping that stands in a job's options.
///
/// Errors  those of parse_column_mapping; `malformed_json` or `wrong_type` where they are no options
Result<ColumnMapping> column_mapping_of(std::string_view options_json);

/// Starts a child, which reads the file, and takes over what it found.
///
/// command  what reads; empty: this binary with the verb `reading-child`
/// Errors   those of reading, with the position; `cannot_start_child`; `unreadable` where the child gave no answer
/// Cost     blocks, 30 s at most; twice the parsed numbers
Result<RawRecording> read_in_child(const FileToRead& file, std::vector<std::string> command = {});

/// The child's whole life: the file to read from standard input, what it holds as lines of JSON on standard output. The
/// exit status: 0 when an answer was given, whatever it was.
int run_reading_child();

}  // namespace valvetriage
