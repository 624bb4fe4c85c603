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
  /// Back to the first byte; false where the source can be read only once.
  virtual bool rewind() = 0;
};

/// A recording from CSV text (CONTRACT section 1).
///
/// mapping   column names where they are not the contract's
/// Errors    every bad input of the contract, with line, column, found and expected
/// Memory    at most 1.3 times the parsed arrays plus a fixed buffer
/// Cost      one pass (two where the source rewinds, to count rows), no allocation per row
Result<RawRecording> parse_csv(ByteSource& source, const std::string& name, const ColumnMapping& mapping);

}  // namespace valvetriage
