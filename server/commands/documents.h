#pragma once

#include <string>

#include "core/model/model.h"
#include "core/model/reference.h"
#include "server/wire/json.h"

namespace valvetriage {

/// Largest JSON document read from a file: a reference of 10,000 knots would be larger, none that is learned is.
inline constexpr std::size_t kMaxDocumentBytes = 64u << 20;

/// For map_error: the error with the name of the file it is in, `standard input` for `-`.
inline auto in_file(std::string file) {
  return [file = file == "-" ? "standard input" : std::move(file)](Error error) {
    error.file = file;
    return error;
  };
}

/// A text file named on the command line, whole; `-` is standard input.
///
/// Errors  `cannot_read`, `too_large` above `most` bytes
Result<std::string> read_text_file(const std::string& file, std::size_t most = kMaxDocumentBytes);

/// A model (schemas/model.schema.json) or a whole identify result.
Result<Model> open_model(const std::string& file);

/// A reference that `reference learn` wrote.
Result<Reference> open_reference(const std::string& file);

/// Writes to the file, or to standard output where it is empty or `-`. A file is replaced whole or not at all.
///
/// Errors  `cannot_write`
Result<void> write_output(const std::string& file, const std::string& text);

}  // namespace valvetriage
