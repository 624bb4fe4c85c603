#pragma once

#include "core/model/reference.h"
#include "server/wire/json.h"

namespace valvetriage {

/// Most good valves, and most levels, a reference from outside may hold.
inline constexpr std::size_t kMaxReferenceMembers = 10000;
inline constexpr std::size_t kMaxKnownTests = 1000;
inline constexpr std::size_t kMaxReferenceLevels = 1000;

/// The reference document: schemas/reference.schema.json. `sha256` is that of its content (see below), whatever the
/// argument carries.
Json to_json(const Reference& reference);

/// SHA-256 of everything but the version, which the store gives, and the hash itself.
std::string reference_sha256(const Reference& reference);

/// A reference from a file or an upload; `sha256` is computed from what was read.
///
/// Errors  of the fields, each with its JSON pointer; sizes that do not fit each other (covariance, map_sd)
Result<Reference> reference_from_json(const Json& document);

}  // namespace valvetriage
