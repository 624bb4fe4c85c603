#pragma once

#include <string>
#include <string_view>

namespace valvetriage::http {

/// A file built into the binary: the page's own (server/web) and openapi.json.
struct Asset {
  std::string_view name;
  std::string_view content_type;
  std::string_view content;
};

/// Null where there is no such file.
const Asset* find_asset(std::string_view name);

}  // namespace valvetriage::http
