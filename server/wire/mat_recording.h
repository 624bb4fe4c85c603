#pragma once

#include <string>
#include <string_view>

#include "core/recording/parse_csv.h"

namespace valvetriage {

/// Whether bytes start like a MATLAB file of any version from 5 on, or an HDF5 file, which version 7.3 is.
bool is_mat(std::string_view first_bytes);

/// A recording from a MATLAB v5 file: equally long real numeric vectors under the contract's or the mapping's names,
/// and metadata as character vectors under the contract's keys.
///
/// To be called only in a process that may die of it: libmatio has a long record of memory errors.
/// Errors  `mat_version` for v7.3 (save with '-v7'), `malformed_mat`, `not_a_number` for a variable that is no real
///         numeric vector, `ragged_columns`, `too_large` before anything large is read, and those of plan_columns
Result<RawRecording> parse_mat_recording(ByteSource& source, const std::string& name, const ColumnMapping& mapping);

/// The same from a file that is not packed, read where it lies: a child of the server may write nothing, so that it has
/// no room for a copy.
Result<RawRecording> parse_mat_file(const std::string& path, const std::string& name, const ColumnMapping& mapping);

}  // namespace valvetriage
