#include "server/report/markup.h"

#include <fmt/format.h>

namespace valvetriage::report {
namespace {

constexpr const char* kStyle = R"(
@page { size: A4; margin: 15mm; }
:root { color-scheme: light; font: 10pt/1.4 system-ui, sans-serif; color: #1b1f24; }
body { margin: 0 auto; max-width: 180mm; padding: 4mm; }
h1 { font-size: 16pt; margin: 0 0 2mm; overflow-wrap: anywhere; } h2 { font-size: 12pt; margin: 6mm 0 2mm; border-bottom: .3mm solid #c4cad1; }
h3 { font-size: 10.5pt; margin: 4mm 0 1mm; }
p, ul { margin: 1.5mm 0; }
table { border-collapse: collapse; width: 100%; font-size: 9pt; } th, td { text-align: left; padding: .8mm 3mm .8mm 0; border-bottom: .2mm solid #e3e6ea; vertical-align: top; overflow-wrap: break-word; }
td:first-child { overflow-wrap: anywhere; min-width: 20mm; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
tr, figure, h2, h3 { break-inside: avoid; } h2, h3 { break-after: avoid; }
figure { margin: 3mm 0; } figcaption { font-size: 9pt; color: #57606a; } svg { width: 100%; height: auto; }
.verdict { font-size: 14pt; font-weight: 600; } .said { border-left: 1mm solid #57606a; padding: 1.5mm 3mm; background: #f5f6f8; }
code { font-size: 8pt; overflow-wrap: anywhere; } .small { font-size: 8.5pt; color: #57606a; }
@media print { body { padding: 0; max-width: none; } .said { print-color-adjust: exact; } }
)";

constexpr const char* kReplacement = "\xEF\xBF\xBD";

}  // namespace

std::string escaped(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else if (c == '"') {
      out += "&quot;";
    } else if (c == '\'') {
      out += "&#39;";
    } else if ((byte < 0x20 && c != '\t' && c != '\n') || byte == 0x7f) {
      out += kReplacement;
    } else {
      out += c;
    }
  }
  return out;
}

std::string html_page(const std::string& title, const std::string& body) {
  return fmt::format(
      "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" "
      "content=\"width=device-width, "
      "initial-scale=1\">\n<title>{}</title>\n<style>{}</style>\n</head>\n<body>\n{}</body>"
      "\n</html>\n",
      escaped(title), kStyle, body);
}

Table::Table(std::vector<Column> columns) : columns_(std::move(columns)) {
  std::vector<std::string> heads;
  for (const Column& column : columns_) heads.push_back(column.head);
  add(heads, "th");
}

void Table::add_row(const std::vector<std::string>& cells) {
  add(cells, "td");
}

void Table::add(const std::vector<std::string>& cells, std::string_view tag) {
  rows_ += "<tr>";
  for (std::size_t i = 0; i < cells.size() && i < columns_.size(); ++i) {
    rows_ += fmt::format("<{0}{1}>{2}</{0}>", tag, columns_[i].numeric ? " class=\"n\"" : "", cells[i]);
  }
  rows_ += "</tr>\n";
}

}  // namespace valvetriage::report
