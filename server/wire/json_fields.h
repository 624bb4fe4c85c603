#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/wire/json.h"

namespace valvetriage {

/// Above 2^53 a JSON number is no exact count.
inline constexpr std::size_t kLargestExactCount = 9'007'199'254'740'992;

/// The fields of one JSON object that came from outside, read by name.
///
/// The first thing wrong is kept in `error` with its JSON pointer, and every later read gives a default value, so that
/// a reader is a list of fields and one check at its end. `null` counts as absent.
///
/// Codes   `missing_field`, `wrong_type`, `unknown_value`, `out_of_range`
class JsonFields {
 public:
  /// `value` may be anything: not being an object is the first error. Both references must outlive the reader.
  JsonFields(const Json& value, std::string pointer, std::optional<Error>& error);

  bool has(std::string_view name) const;

  double number(std::string_view name);
  std::optional<double> optional_number(std::string_view name);
  double number_or(std::string_view name, double otherwise) { return optional_number(name).value_or(otherwise); }
  std::size_t count(std::string_view name, std::size_t largest = kLargestExactCount);
  /// The same where the field is an `int`.
  int small_count(std::string_view name) { return static_cast<int>(count(name, 1'000'000'000)); }
  bool flag(std::string_view name);
  std::string text(std::string_view name);
  std::optional<std::string> optional_text(std::string_view name);
  std::string text_or(std::string_view name, const std::string& otherwise);
  std::vector<double> numbers(std::string_view name);
  std::vector<std::string> texts(std::string_view name);
  std::map<std::string, double> number_by_name(std::string_view name);

  JsonFields object(std::string_view name);
  std::vector<JsonFields> objects(std::string_view name);
  /// Members of the object `name`, in their order, each an object itself.
  std::vector<std::pair<std::string, JsonFields>> objects_by_name(std::string_view name);

  /// The value itself, for what the readers above do not cover; null where it is absent.
  const Json& raw(std::string_view name);
  /// Errors found by the caller: the message is prefixed with the pointer of `name`.
  void refuse(std::string_view name, std::string code, const std::string& what);
  bool ok() const { return !error_->has_value(); }

 private:
  const Json* find(std::string_view name) const;
  const Json* require(std::string_view name, bool (Json::*is_type)() const noexcept, const char* expected);
  std::string pointer_to(std::string_view name) const;

  const Json* value_;
  std::string pointer_;
  std::optional<Error>* error_;
};

}  // namespace valvetriage
