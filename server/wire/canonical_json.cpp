#include "server/wire/canonical_json.h"

#include <cmath>

#include "server/wire/sha256.h"

namespace valvetriage {
namespace {

constexpr double kLargestExactInteger = 9007199254740992.0;  // 2^53

/// nlohmann::json keeps its keys sorted, unlike the ordered kind.
nlohmann::json sorted(const Json& value) {
  if (value.is_object()) {
    nlohmann::json object = nlohmann::json::object();
    for (const auto& [key, member] : value.items()) object[key] = sorted(member);
    return object;
  }
  if (value.is_array()) {
    nlohmann::json list = nlohmann::json::array();
    for (const Json& item : value) list.push_back(sorted(item));
    return list;
  }
  if (value.is_number_float()) {
    const double number = value.get<double>();
    if (std::floor(number) == number && std::abs(number) <= kLargestExactInteger)
      return static_cast<std::int64_t>(number);
    return number;
  }
  if (value.is_number_unsigned()) return value.get<std::uint64_t>();
  if (value.is_number_integer()) return value.get<std::int64_t>();
  if (value.is_boolean()) return value.get<bool>();
  if (value.is_string()) return value.get<std::string>();
  return nullptr;
}

}  // namespace

std::string canonical_json(const Json& document) {
  return sorted(document).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

std::string canonical_sha256(const Json& document) {
  return sha256_hex(canonical_json(document));
}

}  // namespace valvetriage
