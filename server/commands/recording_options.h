#pragma once

#include <CLI/CLI.hpp>
#include <optional>
#include <string>
#include <vector>

#include "server/wire/read_recording.h"

namespace valvetriage {

/// What every verb that reads recordings lets its caller say about them.
struct RecordingOptions {
  std::string columns;                   ///< --columns
  std::optional<double> sample_rate_hz;  ///< --sample-rate-hz
  std::optional<std::string> serial, lot, valve_type, condition, test, stand;
};

/// Adds `--columns` and `--sample-rate-hz`. The options must live as long as the verb.
void add_column_options(CLI::App& verb, RecordingOptions& options);

/// Adds `--serial --lot --valve-type --condition --test --stand`: a value that contradicts the file's is an error.
void add_metadata_options(CLI::App& verb, RecordingOptions& options);

/// The options as the readers take them; files named on a command line are their owner's, so MAT is allowed.
///
/// Errors  `bad_columns`, `bad_sample_rate`, `bad_metadata`
Result<ReadOptions> read_options(const RecordingOptions& options);

/// Reads each file; the first that is bad ends it.
Result<std::vector<ReadRecording>> read_recordings(const std::vector<std::string>& files, const ReadOptions& options);

}  // namespace valvetriage
