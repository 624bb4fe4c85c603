#pragma once

#include <cstddef>

namespace valvetriage {

/// Every limit on a recording from outside, in one place, each with its reason. A recording above one is refused by
/// name (`too_large`), never cut short.

/// Rows. Twelve hours at 200 Hz are 8.6 million; above ten million one analysis would not fit its child's memory.
inline constexpr std::size_t kMaxRows = 10'000'000;

/// Columns of a table. Data loggers write a few dozen; the plan of columns is searched linearly.
inline constexpr std::size_t kMaxColumns = 256;

/// Side inputs that can be named: each costs a full array.
inline constexpr std::size_t kMaxSideInputs = 16;

/// One line, its end included, and so the reader's fixed buffer: 256 columns of 25 characters are a tenth of it.
inline constexpr std::size_t kMaxLineBytes = 65'536;

/// Leading `#` lines together, pairs in them, and one key or value: enough for a complaint of a few paragraphs, and
/// little enough to read before a body is accepted.
inline constexpr std::size_t kMaxMetadataBytes = 65'536;
inline constexpr std::size_t kMaxMetadataPairs = 64;
inline constexpr std::size_t kMaxMetadataKeyBytes = 64;
inline constexpr std::size_t kMaxMetadataValueBytes = 4'096;

/// Name of a column.
inline constexpr std::size_t kMaxColumnNameBytes = 256;

/// Fewest samples: below, neither a noise level nor a first-order response can be told from a handful of points.
inline constexpr std::size_t kMinSamples = 32;

/// Magnitude of a value, in the file's own unit as in ours: the fourth power of what two of them differ by is a number.
inline constexpr double kMostMagnitude = 1e75;

/// Expanded bytes of one recording: kMaxRows rows of three columns with 8 characters each.
inline constexpr std::size_t kMaxExpandedBytes = 256u << 20;

/// Sampling rates that a `--sample-rate-hz` may state: one sample in a day to a digital oscilloscope.
inline constexpr double kMinSampleRateHz = 1e-5;
inline constexpr double kMaxSampleRateHz = 1e9;

}  // namespace valvetriage
