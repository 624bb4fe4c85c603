#pragma once

#include <string>

#include "server/wire/json.h"

namespace valvetriage {

/// What of a document breaks a JSON Schema (draft 7), a line each; empty where nothing does.
std::string schema_violations(const Json& schema, const Json& document);

}  // namespace valvetriage
