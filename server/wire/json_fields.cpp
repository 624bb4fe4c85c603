#include "server/wire/json_fields.h"

#include <fmt/format.h>

#include <cmath>

namespace valvetriage {
namespace {

const Json kNull;

/// What stands there, short enough for a sentence.
std::string shown(const Json& value) {
  constexpr std::size_t kLongest = 40;
  std::string text = dump_json(value);
  if (text.size() > kLongest) text = text.substr(0, kLongest) + "...";
  return text;
}

}  // namespace

JsonFields::JsonFields(const Json& value, std::string pointer, std::optional<Error>& error)
    : value_(&value), pointer_(std::move(pointer)), error_(&error) {
  if (ok() && !value.is_object()) refuse("", "wrong_type", fmt::format("expected an object, found {}", shown(value)));
}

std::string JsonFields::pointer_to(std::string_view name) const {
  return name.empty() ? pointer_ : fmt::format("{}/{}", pointer_, name);
}

void JsonFields::refuse(std::string_view name, std::string code, const std::string& what) {
  if (!ok()) return;
  Error error{.code = std::move(code)};
  error.field = pointer_to(name);
  error.message = fmt::format("{}: {}", error.field.empty() ? "the document" : error.field, what);
  *error_ = std::move(error);
}

const Json* JsonFields::find(std::string_view name) const {
  if (!value_->is_object()) return nullptr;
  const auto at = value_->find(std::string(name));
  return at == value_->end() || at->is_null() ? nullptr : &*at;
}

bool JsonFields::has(std::string_view name) const {
  return find(name) != nullptr;
}

const Json& JsonFields::raw(std::string_view name) {
  const Json* value = find(name);
  return value ? *value : kNull;
}

const Json* JsonFields::require(std::string_view name, bool (Json::*is_type)() const noexcept, const char* expected) {
  if (!ok()) return nullptr;
  const Json* value = find(name);
  if (!value) {
    refuse(name, "missing_field", fmt::format("missing, expected {}", expected));
    return nullptr;
  }
  if (!(value->*is_type)()) {
    refuse(name, "wrong_type", fmt::format("expected {}, found {}", expected, shown(*value)));
    return nullptr;
  }
  return value;
}

double JsonFields::number(std::string_view name) {
  const Json* value = require(name, &Json::is_number, "a number");
  return value ? value->get<double>() : 0;
}

std::optional<double> JsonFields::optional_number(std::string_view name) {
  if (!has(name)) return std::nullopt;
  return number(name);
}

std::size_t JsonFields::count(std::string_view name, std::size_t largest) {
  const double value = number(name);
  if (value < 0 || value > static_cast<double>(largest) || value != std::floor(value)) {
    refuse(name, "out_of_range", fmt::format("expected a whole number from 0 to {}, found {}", largest, value));
    return 0;
  }
  return static_cast<std::size_t>(value);
}

bool JsonFields::flag(std::string_view name) {
  const Json* value = require(name, &Json::is_boolean, "true or false");
  return value && value->get<bool>();
}

std::string JsonFields::text(std::string_view name) {
  const Json* value = require(name, &Json::is_string, "a text");
  return value ? value->get<std::string>() : std::string();
}

std::optional<std::string> JsonFields::optional_text(std::string_view name) {
  if (!has(name)) return std::nullopt;
  return text(name);
}

std::string JsonFields::text_or(std::string_view name, const std::string& otherwise) {
  return has(name) ? text(name) : otherwise;
}

std::vector<double> JsonFields::numbers(std::string_view name) {
  const Json* list = require(name, &Json::is_array, "a list of numbers");
  std::vector<double> values;
  if (!list) return values;
  values.reserve(list->size());
  for (const Json& value : *list) {
    if (!value.is_number()) {
      refuse(name, "wrong_type", fmt::format("item {}: expected a number, found {}", values.size(), shown(value)));
      return {};
    }
    values.push_back(value.get<double>());
  }
  return values;
}

std::vector<std::string> JsonFields::texts(std::string_view name) {
  const Json* list = require(name, &Json::is_array, "a list of texts");
  std::vector<std::string> values;
  if (!list) return values;
  for (const Json& value : *list) {
    if (!value.is_string()) {
      refuse(name, "wrong_type", fmt::format("item {}: expected a text, found {}", values.size(), shown(value)));
      return {};
    }
    values.push_back(value.get<std::string>());
  }
  return values;
}

std::map<std::string, double> JsonFields::number_by_name(std::string_view name) {
  const Json* members = require(name, &Json::is_object, "an object of numbers");
  std::map<std::string, double> values;
  if (!members) return values;
  JsonFields inside(*members, pointer_to(name), *error_);
  for (const auto& [key, value] : members->items()) values[key] = inside.number(key);
  return values;
}

JsonFields JsonFields::object(std::string_view name) {
  const Json* value = require(name, &Json::is_object, "an object");
  return JsonFields(value ? *value : kNull, pointer_to(name), *error_);
}

std::vector<JsonFields> JsonFields::objects(std::string_view name) {
  const Json* list = require(name, &Json::is_array, "a list of objects");
  std::vector<JsonFields> values;
  if (!list) return values;
  for (const Json& value : *list) {
    values.emplace_back(value, fmt::format("{}/{}", pointer_to(name), values.size()), *error_);
  }
  return values;
}

std::vector<std::pair<std::string, JsonFields>> JsonFields::objects_by_name(std::string_view name) {
  const Json* members = require(name, &Json::is_object, "an object");
  std::vector<std::pair<std::string, JsonFields>> values;
  if (!members) return values;
  for (const auto& [key, value] : members->items()) {
    values.emplace_back(key, JsonFields(value, fmt::format("{}/{}", pointer_to(name), key), *error_));
  }
  return values;
}

}  // namespace valvetriage
