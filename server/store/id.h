#pragma once

#include <string>
#include <string_view>

#include "server/store/clock.h"

namespace valvetriage {

/// `prefix` and 26 characters of Crockford's base 32: 48 bits of time, so that ids sort by age, then 80 random bits by
/// libsodium, so that nobody guesses one. Thread-safe.
std::string new_id(std::string_view prefix, TimestampMs now);

/// 128 random bits in hexadecimal.
std::string random_name();

}  // namespace valvetriage
