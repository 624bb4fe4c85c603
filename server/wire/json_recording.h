#pragma once

#include <string>

#include "core/recording/parse_csv.h"
#include "server/wire/json.h"

namespace valvetriage {

/// A recording from `{"metadata": {...}, "columns": {"time_s": [...], ...}}`, read as it streams: no document is built.
///
/// Metadata values are strings, numbers (kept as written) or null (absent); columns are equally long arrays of numbers.
/// Columns that no role uses are skipped. The rules for names, units and metadata are those of the CSV form.
/// Errors   `malformed_json`, `not_a_number`, `not_finite`, `unknown_key`, `duplicate_key`, `ragged_columns`,
///          `time_not_increasing`, `too_large` and those of set_metadata and plan_columns; `field` is a JSON pointer,
///          line and column are where the reader stood
/// Memory   at most 3 times the parsed arrays: their length is not known before they end
Result<RawRecording> parse_json_recording(ByteSource& source, const std::string& name, const ColumnMapping& mapping);

/// The `metadata` object of such a recording.
Json metadata_json(const Metadata& metadata);

}  // namespace valvetriage
