#pragma once

#include <string_view>

#include "core/recording/recording.h"

namespace valvetriage {

/// Bytes of a recording that are looked at before the whole is read.
inline constexpr std::size_t kMetadataHeadBytes = 65'536;

/// The metadata that stand in the first (expanded) bytes of a recording: the `#` lines of a CSV, or the `metadata`
/// object of a JSON recording where it comes before the columns. A MAT file shows none: server/jobs/reading_child.h.
/// Whatever is wrong with the rest of the file is found when it is read.
///
/// Errors  those of set_metadata, with the line in a CSV and the JSON pointer otherwise
Result<Metadata> metadata_head(std::string_view first_bytes);

}  // namespace valvetriage
