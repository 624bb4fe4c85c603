#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace valvetriage {

/// JSON with its keys in the order they were written: what a person reads is in the order the contract gives.
using Json = nlohmann::ordered_json;

/// Deepest nesting accepted from outside. The contract's own documents need 8; a parser that keeps a stack must be
/// bounded.
inline constexpr int kMaxJsonDepth = 64;

/// Parses one JSON document, depth capped while parsing, duplicate keys refused.
///
/// Errors  `malformed_json` with line and column; `json_too_deep`; `duplicate_key`
Result<Json> parse_json(std::string_view text);

/// The document as text: shortest round-trip numbers, two spaces of indent where `pretty`. NaN and infinities become
/// null; invalid UTF-8 is replaced, never thrown on.
std::string dump_json(const Json& document, bool pretty = false);

/// null where there is none.
template <typename T>
Json or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

/// null for NaN and infinities, which JSON has not.
Json finite_or_null(double value);
Json finite_or_null(const std::optional<double>& value);

/// A list, item by item.
template <typename T>
Json list_to_json(const std::vector<T>& items, Json (*item_to_json)(const T&)) {
  Json list = Json::array();
  for (const T& item : items) list.push_back(item_to_json(item));
  return list;
}

}  // namespace valvetriage
