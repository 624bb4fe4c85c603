#pragma once

#include <optional>
#include <string>

#include "core/result.h"
#include "server/wire/json.h"
#include "server/wire/json_fields.h"
#include "server/wire/read_recording.h"

namespace valvetriage {

/// An accepted recording file as a child gets it.
///
/// name          as it was uploaded, for messages and the result
/// options_json  as the upload asked: column mapping, sample rate
/// test          what the upload said of it
struct FileToRead {
  std::string path{};
  std::string name{};
  std::string options_json = "{}";
  std::optional<std::string> test{};
};

Json to_json(const FileToRead& file);
FileToRead file_to_read_from(JsonFields& fields);

/// How that file is read: MAT only where a caller allows it.
///
/// Errors  those of parse_column_mapping; `malformed_json` or `wrong_type` where the options are none
Result<ReadOptions> read_options_of(const FileToRead& file);

/// The column mapping that stands in a job's options.
///
/// Errors  as read_options_of
Result<ColumnMapping> column_mapping_of(std::string_view options_json);

}  // namespace valvetriage
