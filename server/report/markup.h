#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace valvetriage::report {

/// Text as it may stand in HTML and SVG, between tags and in quoted attributes: & < > " ' become entities, control
/// characters other than tab and line feed a replacement sign.
std::string escaped(std::string_view text);

/// A whole HTML page that prints to A4 and needs nothing but itself: no script, no other file. `body` is markup.
std::string html_page(const std::string& title, const std::string& body);

/// A table under a head. Cells are markup; those of numeric columns stand flush right under their heads.
class Table {
 public:
  struct Column {
    std::string head;  ///< markup
    bool numeric = false;
  };
  explicit Table(std::vector<Column> columns);

  /// One cell per column.
  void add_row(const std::vector<std::string>& cells);
  std::string markup() const { return "<table>\n" + rows_ + "</table>\n"; }

 private:
  void add(const std::vector<std::string>& cells, std::string_view tag);

  std::vector<Column> columns_;
  std::string rows_;
};

}  // namespace valvetriage::report
