#pragma once

#include <span>

#include "core/analysis/paper_check.h"
#include "server/wire/json.h"

namespace valvetriage {

/// {"lines":[{"where","as_printed","recomputed","does_not_hold","figures":[{"name","value","unit"}]}]}
Json to_json(std::span<const PaperLine> lines);

}  // namespace valvetriage
