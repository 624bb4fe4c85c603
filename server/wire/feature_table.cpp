#include "server/wire/feature_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace valvetriage {
namespace {

/// What a column of the table means.
struct Column {
  enum class Kind { kIgnored, kSerial, kVerdict, kFeature } kind = Kind::kIgnored;
  Quantity quantity = Quantity::kError;
  std::size_t level = 0;  ///< index into the table's levels
  std::string name;
};

struct Layout {
  char separator = ',';
  std::vector<Column> columns{};
  std::vector<double> levels{};
};

tl::unexpected<Error> at(std::size_t line, std::size_t column, std::string code, const std::string& what) {
  Error error{.code = std::move(code)};
  error.line = line;
  error.column = column;
  error.message = fmt::format("line {}, column {}: {}", line, column, what);
  return tl::unexpected(std::move(error));
}

tl::unexpected<Error> at_field(std::size_t line, std::size_t index, const Column& column, std::string code,
                               std::string_view found, std::string expected) {
  Error error{.code = std::move(code)};
  error.line = line;
  error.column = index + 1;
  error.field = column.name;
  error.found = found;
  error.message = fmt::format("line {}, column {} ({}): '{}' is not {}", line, index + 1, column.name, found, expected);
  error.expected = std::move(expected);
  return tl::unexpected(std::move(error));
}

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r";
  const auto first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::string_view unquoted(std::string_view text) {
  if (text.size() >= 2 && text.front() == '"' && text.back() == '"') return text.substr(1, text.size() - 2);
  return text;
}

std::vector<std::string_view> fields_of(std::string_view line, char separator) {
  std::vector<std::string_view> fields;
  while (true) {
    const auto end = line.find(separator);
    fields.push_back(unquoted(trimmed(line.substr(0, end))));
    if (end == std::string_view::npos) return fields;
    line.remove_prefix(end + 1);
  }
}

char separator_of(std::string_view header) {
  for (const char separator : {'\t', ';'}) {
    if (header.find(separator) != std::string_view::npos) return separator;
  }
  return ',';
}

/// The quantity and the level a column's name spells, nothing for a column of another kind.
std::optional<std::pair<Quantity, double>> feature_of(std::string_view name) {
  constexpr std::pair<std::string_view, Quantity> kPrefixes[] = {{"error_", Quantity::kError},
                                                                 {"settling_error_", Quantity::kSettlingError},
                                                                 {"rise_time_", Quantity::kRiseTime},
                                                                 {"bandwidth_", Quantity::kBandwidthTime}};
  for (const auto& [prefix, quantity] : kPrefixes) {
    if (!name.starts_with(prefix)) continue;
    if (const auto level = level_from_name(name.substr(prefix.size()))) return std::pair{quantity, *level};
  }
  return std::nullopt;
}

std::size_t level_index(std::vector<double>& levels, double level_a) {
  for (std::size_t i = 0; i < levels.size(); ++i) {
    if (std::abs(levels[i] - level_a) < kLevelTolerance) return i;
  }
  levels.push_back(level_a);
  return levels.size() - 1;
}

/// A further quantity is of no use at a level whose error is not in the table.
Result<void> require_errors(const Layout& layout, std::size_t line) {
  std::vector<bool> has_error(layout.levels.size(), false);
  for (const Column& column : layout.columns) {
    if (column.kind == Column::Kind::kFeature && column.quantity == Quantity::kError) has_error[column.level] = true;
  }
  for (std::size_t i = 0; i < has_error.size(); ++i) {
    if (has_error[i]) continue;
    return at(line, 1, "missing_column", fmt::format("the column 'error_{}' is missing", level_name(layout.levels[i])));
  }
  if (layout.levels.empty()) {
    return at(line, 1, "missing_column", "no column 'error_low', 'error_high' or 'error_<level in A>' in the header");
  }
  return {};
}

Result<Layout> read_header(std::string_view header, std::size_t line) {
  Layout layout{.separator = separator_of(header)};
  const auto names = fields_of(header, layout.separator);
  if (names.size() > kMaxTableColumns) {
    return at(line, kMaxTableColumns + 1, "too_large", fmt::format("more than {} columns", kMaxTableColumns));
  }
  for (std::size_t i = 0; i < names.size(); ++i) {
    Column column{.name = std::string(names[i])};
    if (names[i] == "verdict") {
      column.kind = Column::Kind::kVerdict;
    } else if (names[i] == "serial") {
      column.kind = Column::Kind::kSerial;
    } else if (const auto feature = feature_of(names[i])) {
      column.kind = Column::Kind::kFeature;
      column.quantity = feature->first;
      column.level = level_index(layout.levels, feature->second);
    }
    const auto same = [&](const Column& other) {
      return column.kind != Column::Kind::kIgnored && other.kind == column.kind && other.quantity == column.quantity &&
             other.level == column.level;
    };
    if (std::any_of(layout.columns.begin(), layout.columns.end(), same)) {
      return at(line, i + 1, "duplicate_column", fmt::format("'{}' stands twice in the header", names[i]));
    }
    layout.columns.push_back(std::move(column));
  }
  if (auto errors = require_errors(layout, line); !errors) return tl::unexpected(errors.error());
  return layout;
}

std::optional<double> number_of(std::string_view text, char separator) {
  std::string with_point;
  if (separator != ',' && text.find(',') != std::string_view::npos && text.find('.') == std::string_view::npos) {
    with_point = text;
    std::replace(with_point.begin(), with_point.end(), ',', '.');
    text = with_point;
  }
  if (text.starts_with('+')) text.remove_prefix(1);
  double value = 0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (problem != std::errc{} || end != text.data() + text.size()) return std::nullopt;
  return value;
}

/// The features of one row under construction: the error may stand in a later column than what belongs to it.
struct LevelCells {
  std::optional<double> error, settling_error, rise_time_s, bandwidth_hz;

  std::optional<double>& of(Quantity quantity) {
    switch (quantity) {
      case Quantity::kError:
        return error;
      case Quantity::kSettlingError:
        return settling_error;
      case Quantity::kRiseTime:
        return rise_time_s;
      case Quantity::kBandwidthTime:
        return bandwidth_hz;
    }
    return error;
  }
};

Result<double> read_value(std::string_view text, const Layout& layout, std::size_t line, std::size_t index) {
  const Column& column = layout.columns[index];
  const auto value = number_of(text, layout.separator);
  if (!value) return at_field(line, index, column, "not_a_number", text, "a number");
  if (!std::isfinite(*value)) return at_field(line, index, column, "not_finite", text, "a finite number");
  // A settling error may be given with its sign; an Eq 20 error or a rise time below zero is a mistake.
  if (*value < 0 && column.quantity != Quantity::kSettlingError) {
    return at_field(line, index, column, "negative", text, "a number of at least 0");
  }
  if (*value == 0 && column.quantity == Quantity::kBandwidthTime) {
    return at_field(line, index, column, "not_positive", text, "a frequency above 0 Hz");
  }
  return *value;
}

Result<FeatureRow> read_row(std::string_view text, const Layout& layout, std::size_t line) {
  const auto fields = fields_of(text, layout.separator);
  if (fields.size() != layout.columns.size()) {
    return at(line, std::min(fields.size(), layout.columns.size()) + 1, "wrong_field_count",
              fmt::format("{} fields, the header has {}", fields.size(), layout.columns.size()));
  }
  FeatureRow row{.line = line};
  std::vector<LevelCells> cells(layout.levels.size());
  for (std::size_t i = 0; i < fields.size(); ++i) {
    const Column& column = layout.columns[i];
    if (column.kind == Column::Kind::kSerial) {
      row.serial = fields[i];
    } else if (column.kind == Column::Kind::kVerdict) {
      row.verdict = verdict_from(fields[i]);
      if (!row.verdict) return at_field(line, i, column, "unknown_verdict", fields[i], "Good, Malfunctioned or Severe");
    } else if (column.kind == Column::Kind::kFeature && !fields[i].empty()) {
      const auto value = read_value(fields[i], layout, line, i);
      if (!value) return tl::unexpected(value.error());
      cells[column.level].of(column.quantity) = *value;
    }
  }
  for (std::size_t l = 0; l < cells.size(); ++l) {
    if (!cells[l].error) continue;  // this level was not measured on this valve
    row.levels.push_back(
        {layout.levels[l], *cells[l].error, cells[l].settling_error, cells[l].rise_time_s, cells[l].bandwidth_hz});
  }
  return row;
}

FeatureTable table_of(const Layout& layout) {
  FeatureTable table;
  for (const Column& column : layout.columns) {
    if (column.kind == Column::Kind::kFeature) table.feature_columns.push_back(column.name);
    table.has_verdicts = table.has_verdicts || column.kind == Column::Kind::kVerdict;
  }
  return table;
}

}  // namespace

Result<FeatureTable> parse_feature_table(std::string_view text) {
  if (text.size() > kMaxTableBytes) {
    return fail("too_large", fmt::format("a table of {} bytes: at most {} are accepted", text.size(), kMaxTableBytes));
  }
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  std::optional<Layout> layout;
  FeatureTable table;
  for (std::size_t line = 1; !text.empty(); ++line) {
    const auto end = text.find('\n');
    const std::string_view row_text = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (trimmed(row_text).empty() || row_text.starts_with('#')) continue;
    if (!layout) {
      auto header = read_header(row_text, line);
      if (!header) return tl::unexpected(header.error());
      layout = std::move(*header);
      table = table_of(*layout);
      continue;
    }
    if (table.rows.size() == kMaxTableRows) {
      return at(line, 1, "too_large", fmt::format("more than {} rows", kMaxTableRows));
    }
    auto row = read_row(row_text, *layout, line);
    if (!row) return tl::unexpected(row.error());
    table.rows.push_back(std::move(*row));
  }
  if (table.rows.empty())
    return fail("no_rows", "the table has no rows: expected a header line and one line per valve");
  return table;
}

Result<std::vector<LabelledValve>> labelled_valves(const FeatureTable& table) {
  if (!table.has_verdicts) {
    return fail("missing_column", "the column 'verdict' (Good, Malfunctioned or Severe) is missing");
  }
  std::vector<LabelledValve> valves;
  for (const FeatureRow& row : table.rows) valves.push_back({*row.verdict, row.levels});
  return valves;
}

}  // namespace valvetriage
