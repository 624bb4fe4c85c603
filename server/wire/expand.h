#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string_view>

#include "core/recording/parse_csv.h"

namespace valvetriage {

enum class Compression { kNone, kGzip, kZstd };

/// "x.csv.gz" -> kGzip, "x.csv.zst" -> kZstd, in any case; else kNone.
Compression compression_of_name(std::string_view file_name);
/// The name of what is inside: "x.csv.gz" -> "x.csv".
std::string_view expanded_name(std::string_view file_name);
/// "gzip", "x-gzip", "zstd", "identity" and "" of Content-Encoding; nothing for any other.
std::optional<Compression> compression_of_encoding(std::string_view content_encoding);

/// By the first bytes: gzip 1f 8b, zstd 28 b5 2f fd or a skippable frame.
Compression compression_of_bytes(std::string_view first_bytes);

/// Windows of zstd frames as base 2 logarithms [bytes].
///
/// kToolsZstdWindowLog2    128 MiB, what the zstd tool itself accepts without being asked
/// kUploadZstdWindowLog2   8 MiB, what levels up to 19 use: so much is held for each of many uploads at a time
inline constexpr int kToolsZstdWindowLog2 = 27, kUploadZstdWindowLog2 = 23;

/// The expanded bytes of a compressed source, which has to live longer. kNone counts the bytes and nothing else.
/// gzip members and zstd frames that follow each other are one text.
///
/// max_bytes         bound of the expanded bytes and of the compressed ones
/// zstd_window_log2  of the largest window that a frame may have
/// Errors            `too_large`; `malformed_encoding` (broken, cut off, not compressed at all, a larger window); those
///                   of the source
/// Memory            a fixed buffer, for zstd at most a window
std::unique_ptr<ByteSource> expand(Compression compression, ByteSource& source, std::uint64_t max_bytes,
                                   int zstd_window_log2 = kToolsZstdWindowLog2);
/// The same by the first bytes, whatever the file is called.
std::unique_ptr<ByteSource> expand(ByteSource& source, std::uint64_t max_bytes,
                                   int zstd_window_log2 = kToolsZstdWindowLog2);

}  // namespace valvetriage
