#pragma once

#include <optional>
#include <string>

#include "core/recording/parse_csv.h"

namespace valvetriage::http {

/// Head of one part of a multipart/form-data body.
struct PartHead {
  std::string name;
  std::string file_name;  ///< last component only, never a path
};

/// Reads a multipart/form-data body part by part, in one pass and in fixed memory.
///
///   while (part = reader.next()) { read until 0 }
class MultipartReader : public ByteSource {
 public:
  /// body lives longer than the reader.
  MultipartReader(ByteSource& body, const std::string& boundary);

  /// The next part's head, what is left of the current one is skipped; nothing after the last.
  /// Errors  `malformed_multipart`, the body's own
  Result<std::optional<PartHead>> next();

  /// Bytes of the current part; 0 at its end.
  Result<std::size_t> read(std::span<char> buffer) override;
  bool rewind() override { return false; }

 private:
  Result<bool> fill();
  Result<std::string> take_until(std::string_view mark, std::size_t max_bytes);

  ByteSource& body_;
  std::string delimiter_;  ///< CR LF "--" boundary
  std::string buffer_;
  bool in_part_ = true;  ///< before the first delimiter lies the preamble, skipped like a part
  bool ended_ = false;
};

/// The boundary of a Content-Type value; nothing where it is not multipart/form-data with a valid boundary.
std::optional<std::string> multipart_boundary(std::string_view content_type);

}  // namespace valvetriage::http
