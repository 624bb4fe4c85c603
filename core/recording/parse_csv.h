#pragma once

#include <cstddef>
#include <span>

#include "core/recording/recording.h"

namespace valvetriage {

/// Bytes of an expanded text, read in order and, where `rewind` succeeds, once more from the start.
/// The core opens no files: the server gives it one of these over a file, a pipe or memory.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  /// Fills up to buffer.size() bytes; 0 at the end.
  virtual Result<std::size_t> read(std::span<char> buffer) = 0;
  /// Back to the first byte; false where the source can be read only once. Always true where nothing was read yet and
  /// it will be true later: a caller asks before the first read whether a second pass is possible.
  virtual bool rewind() = 0;
};

/// A recording from CSV text.
///
///   [UTF-8 BOM]  { "# key: value" LF }  header LF  { row LF }       LF or CRLF, blank lines skipped
///
/// The separator is the first of `;`, tab and `,` that stands in the header. With `;` or tab the first number that has
/// a
/// `,` or a `.` decides which of them is the decimal mark of the file. Fields may be quoted ("1.5") and padded with
/// blanks; every row has as many fields as the header. Columns that no role uses are skipped unread, but not bytes that
/// are no text.
///
/// mapping   column names where they are not the contract's
/// Errors    with line, column, found and expected: `not_a_number not_finite time_not_increasing ragged_row bad_text
///           no_samples too_few_samples too_large misplaced_metadata`, and those of parse_metadata_line and
///           plan_columns
/// Memory    at most 1.3 times the parsed arrays plus a fixed buffer where the source rewinds (rows are counted first),
///           at most 3 times where it does not
/// Cost      two passes over the bytes, one of them counting only; no allocation per row; one source, one thread
Result<RawRecording> parse_csv(ByteSource& source, const std::string& name, const ColumnMapping& mapping);

}  // namespace valvetriage
