#pragma once

#include <string>
#include <string_view>

namespace valvetriage {

/// Without spaces, tabs and carriage returns at both ends.
std::string_view trim(std::string_view text);

/// UTF-8 without NUL and other control characters (tab allowed): what may be stored, shown and logged.
bool is_clean_utf8(std::string_view text);

/// The first byte that keeps it from being so; npos where there is none.
std::size_t first_unclean(std::string_view text);

/// What that byte is, as the end of a sentence: "is not UTF-8 text: ...".
std::string_view unclean_words(std::string_view text);

/// What stood in a file, fit for an error message: at most 40 bytes, bytes that are not clean text as \xNN.
std::string shown(std::string_view text);

/// ASCII lower case; other bytes as they are.
std::string to_lower_ascii(std::string_view text);

}  // namespace valvetriage
