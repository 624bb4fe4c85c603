#pragma once

#include <span>
#include <string>
#include <string_view>

#include "core/recording/recording.h"

namespace valvetriage {

/// A key that the contract names, and where its value is kept.
struct MetadataKey {
  std::string_view name;
  std::optional<std::string> Metadata::*field;
};

/// serial lot valve_type condition test stand tested_at operator claim complaint hours.
std::span<const MetadataKey> metadata_keys();

/// Sets one pair. Keys are compared without regard to case.
///
/// Errors  `duplicate_metadata` where the key has a value already; `bad_metadata` for an unknown `test` or `condition`,
///         text that is not clean UTF-8, a key or value above its limit (limits.h)
Result<void> set_metadata(Metadata& metadata, std::string_view key, std::string_view value);

/// Reads one leading line of a CSV text, with its `#`.
///
/// A line holds `# key: value` once or several times. A key is a letter followed by letters, digits, `_`, `-` or `.`.
/// A value ends before the next ` # `, whether a pair or a comment follows, and before a remark in parentheses that two
/// or more blanks set off from it: in `# condition: returned    (as sent in)` the value is `returned`. A line whose
/// text is no pair is a comment. An empty value counts as absent.
Result<void> parse_metadata_line(Metadata& metadata, std::string_view line);

/// The metadata in the leading `#` lines of a CSV text, from its first bytes alone: for callers that must know serial
/// and lot before they read the whole. Stops at the first other line, at kMaxMetadataBytes and at an unfinished line.
/// Text that is no CSV has no such lines and gives empty metadata.
///
/// Errors  as parse_metadata_line, with the line
/// Cost    O(bytes of the head)
Result<Metadata> read_metadata_head(std::string_view first_bytes);

/// Adds what options or query parameters say. A value that contradicts the file's is an error, never chosen.
///
/// Errors  `contradicting_metadata` naming the key and both values
Result<void> apply_metadata_options(Metadata& metadata, const Metadata& options);

}  // namespace valvetriage
