#pragma once

#include <memory>
#include <string_view>

#include "core/recording/limits.h"
#include "core/recording/parse_csv.h"

namespace valvetriage {

/// Whole lines of a text out of one fixed buffer of kMaxLineBytes.
class LineReader {
 public:
  explicit LineReader(ByteSource& source) : source_(source), buffer_(std::make_unique<char[]>(kMaxLineBytes + 1)) {}

  /// The next lines, as many as the buffer holds, the last one ended by '\n' as well (added where the text ends without
  /// one); empty at the end of the text. Valid until the next call.
  ///
  /// Errors  `too_large` for a line above kMaxLineBytes (the caller adds its number); the source's own
  Result<std::string_view> next_block();

 private:
  Result<void> fill();

  ByteSource& source_;
  std::unique_ptr<char[]> buffer_;  ///< one byte more than a line, for the added '\n'
  std::size_t begin_ = 0;           ///< first byte not handed out yet
  std::size_t size_ = 0;
  bool at_end_ = false;
};

}  // namespace valvetriage
