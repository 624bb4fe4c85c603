#pragma once

#include <string>
#include <string_view>

namespace valvetriage::report {

/// Text as it may stand in HTML and SVG, between tags and in quoted attributes: & < > " ' become entities, control
/// characters other than tab and line feed a replacement sign.
std::string escaped(std::string_view text);

/// A whole HTML page that prints to A4 and needs nothing but itself: no script, no other file. `body` is markup.
std::string html_page(const std::string& title, const std::string& body);

/// A row of a table; the cells are markup. `tag` is td or th.
std::string table_row(std::initializer_list<std::string> cells, std::string_view tag = "td");

}  // namespace valvetriage::report
