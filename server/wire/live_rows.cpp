#include "server/wire/live_rows.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iterator>
#include <string>

#include "core/recording/text.h"

namespace valvetriage {
namespace {

std::vector<std::string_view> split(std::string_view line, char separator) {
  std::vector<std::string_view> fields;
  while (true) {
    const std::size_t end = line.find(separator);
    std::string_view field = trim(line.substr(0, end));
    if (field.size() >= 2 && field.front() == '"' && field.back() == '"') field = field.substr(1, field.size() - 2);
    fields.push_back(field);
    if (end == std::string_view::npos) return fields;
    line.remove_prefix(end + 1);
  }
}

char separator_of(std::string_view header) {
  const std::size_t at = header.find_first_of(";\t,");
  return at == std::string_view::npos ? ',' : header[at];
}

Error at_field(const char* code, std::size_t line, const PlannedColumn& column, std::string_view found,
               const char* expected) {
  Error error{.code = code};
  error.line = line;
  error.column = column.index + 1;
  error.field = column.channel.name;
  error.found = shown(found);
  error.expected = expected;
  error.message = fmt::format("line {}, column {} ({}): '{}' is not {}", line, column.index + 1, column.channel.name,
                              error.found, expected);
  return error;
}

}  // namespace

Result<void> LiveRows::read_header(const std::vector<std::string_view>& fields) {
  auto planned = plan_columns({fields.begin(), fields.end()}, mapping_);
  if (!planned) {
    Error error = planned.error();
    error.line = line_;
    return tl::unexpected(error);
  }
  columns_ = std::move(*planned);
  fields_ = fields.size();
  return {};
}

Result<double> LiveRows::read_field(const std::vector<std::string_view>& fields, const PlannedColumn& column) const {
  std::string text(fields[column.index]);
  if (separator_ != ',') std::replace(text.begin(), text.end(), ',', '.');
  double value = 0;
  const auto [end, problem] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (problem != std::errc{} || end != text.data() + text.size()) {
    return tl::unexpected(at_field("not_a_number", line_, column, fields[column.index], "a number"));
  }
  if (!std::isfinite(value)) {
    return tl::unexpected(at_field("not_finite", line_, column, fields[column.index], "a finite number"));
  }
  return value * column.channel.file_unit_scale;
}

Error LiveRows::at_line(Error error) const {
  error.line = line_;
  error.message = fmt::format("line {}: {}", line_, error.message);
  return error;
}

Result<std::optional<LiveRow>> LiveRows::take(std::string_view line) {
  ++line_;
  if (line_ == 1 && line.starts_with("\xEF\xBB\xBF")) line.remove_prefix(3);
  line = trim(line);
  if (line.empty()) return std::nullopt;
  if (line.front() == '#') {
    if (!columns_.empty()) return std::nullopt;
    if (auto parsed = parse_metadata_line(said_, line); !parsed) return tl::unexpected(at_line(parsed.error()));
    Metadata both = said_;
    if (auto agrees = apply_metadata_options(both, given_); !agrees) return tl::unexpected(at_line(agrees.error()));
    return std::nullopt;
  }
  if (columns_.empty()) separator_ = separator_of(line);
  const auto fields = split(line, separator_);
  if (columns_.empty()) {
    if (auto header = read_header(fields); !header) return tl::unexpected(header.error());
    return std::nullopt;
  }
  if (fields.size() != fields_) {
    Error error{.code = "ragged_row"};
    error.line = line_;
    error.message = fmt::format("line {}: {} fields, the header has {}", line_, fields.size(), fields_);
    return tl::unexpected(error);
  }
  LiveRow row;
  if (mapping_.sample_rate_hz) row.time_s = static_cast<double>(rows_) / *mapping_.sample_rate_hz;
  double* const roles[] = {&row.time_s, &row.input, &row.output};  // the order of plan_columns; side inputs follow
  const std::size_t without_time = mapping_.sample_rate_hz ? 1 : 0;
  for (std::size_t i = without_time; i < std::size(roles); ++i) {
    const auto value = read_field(fields, columns_[i - without_time]);
    if (!value) return tl::unexpected(value.error());
    *roles[i] = *value;
  }
  if (rows_ > 0 && !(row.time_s > last_time_s_)) {
    Error error{.code = "time_not_increasing"};
    error.line = line_;
    error.message = fmt::format("line {}: the time {} s does not increase after {} s", line_, row.time_s, last_time_s_);
    return tl::unexpected(error);
  }
  if (rows_ == 0) first_time_s_ = row.time_s;
  last_time_s_ = row.time_s;
  ++rows_;
  return row;
}

double LiveRows::sample_period_s() const {
  return rows_ > 1 ? (last_time_s_ - first_time_s_) / static_cast<double>(rows_ - 1) : 0;
}

}  // namespace valvetriage
