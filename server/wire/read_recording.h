#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "core/recording/limits.h"
#include "core/recording/parse_csv.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// How a recording is read, from the command line's options or a request's query.
struct ReadOptions {
  std::string name;       ///< file name or title for messages and the result; empty: the path's last part
  ColumnMapping mapping;  ///< `--columns`, `--sample-rate-hz`
  Metadata metadata;      ///< `serial lot valve_type condition test stand` given beside the file
  std::uint64_t max_expanded_bytes = kMaxExpandedBytes;
  /// MAT files are read by a library with a long record of memory errors: only where the process is the reader's own,
  /// a sandboxed child or a command of the file's owner. Elsewhere they are refused (`mat_not_allowed`).
  bool allow_mat = false;
};

/// A recording ready for analysis, and the identity of its bytes.
struct ReadRecording {
  Recording recording;
  std::string sha256;  ///< of the expanded bytes, lower-case hex
  std::size_t expanded_bytes = 0;
};

/// What a file holds, by its first expanded bytes: never by its name.
enum class RecordingFormat { kCsv, kJson, kMat };
RecordingFormat format_of(std::string_view first_bytes);

/// Reads, converts and prepares one recording: expand, tell the format, parse, merge metadata, prepare.
///
/// Errors  all that a recording can be refused for, with file, line, column, found and expected, and `cannot_read`,
///         `malformed_encoding`, `contradicting_metadata`, `mat_not_allowed`
/// Cost    linear in the bytes; reentrant
Result<ReadRecording> read_recording(ByteSource& source, const ReadOptions& options);
Result<ReadRecording> read_recording_file(const std::string& path, const ReadOptions& options);
Result<ReadRecording> read_recording_descriptor(int descriptor, const ReadOptions& options);
Result<ReadRecording> read_recording_memory(std::string_view bytes, const ReadOptions& options);

/// The columns as they stood, converted but neither checked nor resampled: for output at the file's own stamps.
Result<RawRecording> read_raw_recording_file(const std::string& path, const ReadOptions& options);

}  // namespace valvetriage
