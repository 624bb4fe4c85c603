#pragma once

#include <string>
#include <string_view>

#include "core/result.h"

namespace valvetriage {

/// Our own stored documents, compressed for the database. Thread-safe.
std::string compress_text(std::string_view text);

/// Errors  `store_broken` if the bytes are not what compress_text gave
Result<std::string> expand_text(std::string_view compressed);

}  // namespace valvetriage
