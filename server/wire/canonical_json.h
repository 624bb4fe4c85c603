#pragma once

#include <string>

#include "server/wire/json.h"

namespace valvetriage {

/// One text for one meaning, so that a hash can stand for a document: keys sorted, no spaces, shortest round-trip
/// numbers, a whole number written as an integer however it was given (1, 1.0), negative zero as 0.
std::string canonical_json(const Json& document);

/// SHA-256 of the canonical text.
std::string canonical_sha256(const Json& document);

}  // namespace valvetriage
