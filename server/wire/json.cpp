#include "server/wire/json.h"

#include <fmt/format.h>

#include <cmath>
#include <set>
#include <vector>

namespace valvetriage {
namespace {

struct Position {
  std::size_t line = 1;
  std::size_t column = 1;
};

Position position_of(std::string_view text, std::size_t byte) {
  Position at;
  for (std::size_t i = 0; i + 1 < byte && i < text.size(); ++i) {
    if (text[i] == '\n') {
      ++at.line;
      at.column = 1;
    } else {
      ++at.column;
    }
  }
  return at;
}

}  // namespace

Result<Json> parse_json(std::string_view text) {
  bool too_deep = false;
  std::string duplicate;
  std::vector<std::set<std::string>> open_objects;
  const auto watch = [&](int depth, Json::parse_event_t event, Json& parsed) {
    using enum Json::parse_event_t;
    if (event == object_start || event == array_start) {
      too_deep = too_deep || depth >= kMaxJsonDepth;
      if (event == object_start) open_objects.emplace_back();
    } else if (event == object_end) {
      if (!open_objects.empty()) open_objects.pop_back();
    } else if (event == key && !open_objects.empty()) {
      const auto& name = parsed.get_ref<const std::string&>();
      if (!open_objects.back().insert(name).second && duplicate.empty()) duplicate = name;
    }
    return !too_deep;  // nothing below the cap is kept in memory
  };
  try {
    Json document = Json::parse(text, watch);
    if (too_deep) {
      return fail("json_too_deep", fmt::format("the JSON nests deeper than {} levels", kMaxJsonDepth));
    }
    if (!duplicate.empty()) {
      return fail("duplicate_key", fmt::format("the key '{}' stands twice in one object", duplicate));
    }
    return document;
  } catch (const nlohmann::json::parse_error& error) {
    const Position at = position_of(text, error.byte);
    Error problem{.code = "malformed_json"};
    problem.line = at.line;
    problem.column = at.column;
    const bool at_end = error.byte == 0 || error.byte > text.size();
    problem.found = at_end ? "end of text" : std::string(1, text[error.byte - 1]);
    problem.expected = "JSON";
    problem.message = fmt::format("line {}, column {}: not JSON at '{}'", at.line, at.column, problem.found);
    return tl::unexpected(problem);
  } catch (const nlohmann::json::exception& error) {
    return fail("malformed_json", fmt::format("not JSON: {}", error.what()));
  }
}

Json finite_or_null(double value) {
  return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json finite_or_null(const std::optional<double>& value) {
  return value ? finite_or_null(*value) : Json(nullptr);
}

std::string dump_json(const Json& document, bool pretty) {
  return document.dump(pretty ? 2 : -1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace valvetriage
