#include "core/recording/parse_csv.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string_view>

#include "core/recording/columns.h"
#include "core/recording/limits.h"
#include "core/recording/line_reader.h"
#include "core/recording/metadata.h"
#include "core/recording/text.h"

namespace valvetriage {
namespace {

constexpr int kSkipped = -1;

Error at_line(Error error, std::size_t line) {
  error.line = line;
  error.message = fmt::format("line {}: {}", line, error.message);
  return error;
}

std::string_view without_carriage_return(std::string_view line) {
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

/// In blocks whose counts fit a byte, which the compiler turns into vector code: many times faster than std::count.
std::size_t count_newlines(std::string_view text) {
  constexpr std::size_t kBlock = 32 * 255;
  std::size_t total = 0;
  for (std::size_t begin = 0; begin < text.size(); begin += kBlock) {
    const std::string_view block = text.substr(begin, kBlock);
    std::array<std::uint8_t, 32> counts{};
    std::size_t i = 0;
    for (; i + counts.size() <= block.size(); i += counts.size()) {
      for (std::size_t k = 0; k < counts.size(); ++k)
        counts[k] = static_cast<std::uint8_t>(counts[k] + (block[i + k] == '\n'));
    }
    for (const std::uint8_t count : counts) total += count;
    for (; i < block.size(); ++i) total += block[i] == '\n';
  }
  return total;
}

/// Reads a text once to its end and goes back to its start. Nothing where the source cannot be read twice.
Result<std::optional<std::size_t>> count_lines(ByteSource& source) {
  if (!source.rewind()) return std::nullopt;
  std::array<char, 16'384> buffer;
  std::size_t lines = 1;
  for (;;) {
    const auto got = source.read(buffer);
    if (!got) return tl::unexpected(got.error());
    if (*got == 0) break;
    lines += count_newlines({buffer.data(), *got});
  }
  if (!source.rewind()) return fail("cannot_read", "the input cannot be read a second time");
  return lines;
}

/// Fields of one line, split at the separator outside quotes. A quoted field loses its quotes; "" inside is one quote.
class FieldSplitter {
 public:
  FieldSplitter(std::string_view line, char separator) : rest_(line), separator_(separator) {}

  std::optional<std::string_view> next() {
    if (done_) return std::nullopt;
    const std::size_t quote = rest_.find_first_not_of(separator_ == '\t' ? " " : " \t");
    if (quote != std::string_view::npos && rest_[quote] == '"') return quoted(quote + 1);
    return plain(0);
  }

 private:
  std::string_view plain(std::size_t from) {
    const std::size_t end = std::min(rest_.find(separator_, from), rest_.size());
    const std::string_view field = trim(rest_.substr(0, end));
    done_ = end == rest_.size();
    rest_.remove_prefix(done_ ? end : end + 1);
    return field;
  }

  std::string_view quoted(std::size_t begin) {
    unquoted_.clear();
    std::size_t i = begin;
    for (; i < rest_.size(); ++i) {
      if (rest_[i] == '"') {
        if (i + 1 >= rest_.size() || rest_[i + 1] != '"') break;
        ++i;
      }
      unquoted_ += rest_[i];
    }
    if (i == rest_.size()) return plain(i);  // the quote is never closed: the whole rest is the field, quote included
    const std::string_view whole = plain(i);
    return whole.ends_with('"') ? trim(unquoted_) : whole;
  }

  std::string_view rest_;
  char separator_;
  bool done_ = false;
  std::string unquoted_;
};

/// A plain decimal of at most 15 digits, at `at` in a text that ends in '\n'; the place after it, nullptr for any other
/// number. Digits and power of ten are exact doubles, so one division gives the correctly rounded value, the one that
/// std::from_chars gives (Clinger 1990), in less time.
inline const char* read_short_decimal(const char* at, double& value) {
  constexpr std::ptrdiff_t kExactDigits = 15;
  constexpr std::array<double, kExactDigits + 1> kPowerOfTen{1e0, 1e1, 1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                                             1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15};
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  const bool negative = *at == '-';
  at += negative;
  std::uint64_t digits = 0;
  const char* const whole = at;
  for (; is_digit(*at); ++at) digits = 10 * digits + static_cast<std::uint64_t>(*at - '0');
  if (at == whole) return nullptr;
  std::ptrdiff_t count = at - whole, decimals = 0;
  if (*at == '.') {
    const char* const fraction = ++at;
    for (; is_digit(*at); ++at) digits = 10 * digits + static_cast<std::uint64_t>(*at - '0');
    decimals = at - fraction;
    count += decimals;
  }
  if (count > kExactDigits || *at == 'e' || *at == 'E') return nullptr;
  const double magnitude = static_cast<double>(digits) / kPowerOfTen[static_cast<std::size_t>(decimals)];
  value = negative ? -magnitude : magnitude;
  return at;
}

class CsvParser {
 public:
  CsvParser(ByteSource& source, const std::string& name, const ColumnMapping& mapping)
      : lines_(source), mapping_(mapping) {
    raw_.name = name;
  }

  Result<RawRecording> parse(std::optional<std::size_t> expected_lines);

 private:
  Result<void> read_head_line(std::string_view text);
  Result<void> read_header(std::string_view text);
  Result<void> read_rows(const char* at, const char* end);
  const char* read_plain_row(const char* at, const char* end);
  Result<void> read_any_row(std::string_view text);
  Result<double> read_number(std::string_view field, std::size_t column);
  bool keep_row();
  Error bad_row() const;
  void reserve(std::size_t rows);
  Error row_error(std::string code, std::size_t column, std::string_view found, std::string expected,
                  std::string_view sentence) const;

  LineReader lines_;
  const ColumnMapping& mapping_;
  RawRecording raw_;
  std::size_t line_ = 0;  ///< number of the line being read
  std::size_t metadata_bytes_ = 0;
  std::size_t expected_rows_ = 0;
  std::vector<std::string> names_;  ///< of the header; empty before it
  std::vector<PlannedColumn> plan_;
  std::vector<int> place_;                     ///< per file column: index into row_, or kSkipped
  std::vector<double> row_;                    ///< numbers of the row being read, in the plan's order
  std::vector<std::vector<double>*> targets_;  ///< of the plan's channels, in its order
  bool has_time_ = false;
  std::size_t rows_ = 0;
  char separator_ = ',';
  char decimal_ = '.';  ///< '\0' while no number of the file has shown it
  double last_time_ = -std::numeric_limits<double>::infinity();
};

Error CsvParser::row_error(std::string code, std::size_t column, std::string_view found, std::string expected,
                           std::string_view sentence) const {
  Error error{.code = std::move(code)};
  error.line = line_;
  error.column = column + 1;
  error.field = shown(names_[column]);
  error.found = shown(found);
  error.expected = std::move(expected);
  error.message =
      fmt::format("line {}, column {} ({}): '{}' {}", line_, column + 1, error.field, error.found, sentence);
  return error;
}

/// A row of nothing but plain decimal numbers, which almost every row is. The row is in row_ and the place after its
/// end is returned; nullptr where anything needs a closer look, be it an error or a quote.
const char* CsvParser::read_plain_row(const char* at, const char* end) {
  const char separator = separator_;
  double* const row = row_.data();
  const int* place = place_.data();
  const int* const last = place + place_.size() - 1;
  for (;; ++place) {
    if (*place == kSkipped) {
      while (*at >= ' ' && *at < 0x7F && *at != separator && *at != '"') ++at;
    } else {
      double value = 0;
      const char* next = read_short_decimal(at, value);
      if (next == nullptr) {
        const auto [after, problem] = std::from_chars(at, end, value);
        if (problem != std::errc{}) return nullptr;
        next = after;
      }
      row[*place] = value;
      at = next;
    }
    if (place == last) break;
    if (*at++ != separator) return nullptr;
  }
  if (*at == '\r') ++at;
  return *at == '\n' ? at + 1 : nullptr;
}

Result<double> CsvParser::read_number(std::string_view field, std::size_t column) {
  const auto problem = [&](std::string code, std::string expected, std::string_view sentence) {
    return tl::unexpected(row_error(std::move(code), column, field, std::move(expected), sentence));
  };
  if (field.empty()) return problem("not_a_number", "a number", "is not a number");
  if (decimal_ == '\0' && field.find_first_of(".,") != std::string_view::npos) {
    decimal_ = field[field.find_first_of(".,")];
  }
  std::string plain(field.starts_with('+') && !field.starts_with("+-") ? field.substr(1) : field);
  if (decimal_ == ',') {
    if (plain.find('.') != std::string::npos) {
      return problem("not_a_number", "a number with decimal ','", "is not a number with decimal ','");
    }
    std::ranges::replace(plain, ',', '.');
  }
  double value = 0;
  const auto [end, status] = std::from_chars(plain.data(), plain.data() + plain.size(), value);
  if (end != plain.data() + plain.size() || status == std::errc::invalid_argument) {
    return problem("not_a_number", "a number", "is not a number");
  }
  if (status == std::errc::result_out_of_range || !std::isfinite(value)) {
    return problem("not_finite", "a finite number", "is not a finite number of double precision");
  }
  return value;
}

Result<void> CsvParser::read_any_row(std::string_view text) {
  if (const std::size_t at = first_unclean(text); at != std::string_view::npos) {
    const auto before = static_cast<std::size_t>(std::ranges::count(text.substr(0, at), separator_));
    const std::size_t column = std::min(before, names_.size() - 1);
    return tl::unexpected(
        row_error("bad_text", column, text, "UTF-8 text without control characters", unclean_words(text)));
  }
  FieldSplitter fields(text, separator_);
  std::size_t column = 0;
  for (auto field = fields.next(); field; field = fields.next(), ++column) {
    if (column >= place_.size() || place_[column] == kSkipped) continue;
    const auto value = read_number(*field, column);
    if (!value) {
      // a short line's last field is wrong because of what is missing after it, not for its own sake
      if (field->empty() && column + 1 < place_.size() && !fields.next()) break;
      return tl::unexpected(value.error());
    }
    row_[static_cast<std::size_t>(place_[column])] = *value;
  }
  if (column == place_.size()) return {};
  Error error{.code = "ragged_row"};
  error.line = line_;
  error.column = std::min(column, place_.size()) + 1;
  error.found = fmt::format("{} fields", column);
  error.expected = fmt::format("{} fields", place_.size());
  error.message = fmt::format("line {}: {} fields, the header has {}", line_, column, place_.size());
  return tl::unexpected(error);
}

/// Why a row of numbers cannot follow the rows before it.
Error CsvParser::bad_row() const {
  for (std::size_t i = 0; i < plan_.size(); ++i) {
    if (std::isfinite(row_[i])) continue;
    return row_error("not_finite", plan_[i].index, fmt::format("{}", row_[i]), "a finite number",
                     "is not a finite number");
  }
  if (rows_ == kMaxRows) return at_line(fail("too_large", fmt::format("more than {} rows", kMaxRows)).value(), line_);
  return row_error("time_not_increasing", plan_.front().index, fmt::format("{}", row_.front()),
                   fmt::format("a time after {}", last_time_), fmt::format("does not come after {}", last_time_));
}

inline bool CsvParser::keep_row() {
  const double* const row = row_.data();
  const std::size_t columns = targets_.size();
  double finite = 0;  // x - x is 0 for a finite x and NaN for any other
  for (std::size_t i = 0; i < columns; ++i) finite += row[i] - row[i];
  if (finite != 0 || rows_ == kMaxRows || (has_time_ && row[0] <= last_time_)) return false;
  last_time_ = row[0];
  std::vector<double>* const* const targets = targets_.data();
  for (std::size_t i = 0; i < columns; ++i) targets[i]->push_back(row[i]);
  ++rows_;
  return true;
}

Result<void> CsvParser::read_rows(const char* at, const char* end) {
  while (at != end) {
    ++line_;
    const char* next = decimal_ == '.' ? read_plain_row(at, end) : nullptr;
    if (next == nullptr) {
      next = std::find(at, end, '\n') + 1;
      const std::string_view text = without_carriage_return({at, static_cast<std::size_t>(next - at - 1)});
      const std::string_view content = trim(text);
      at = next;
      if (content.empty()) continue;
      if (content.starts_with('#')) {
        return tl::unexpected(row_error("misplaced_metadata", 0, content, "numbers",
                                        "stands after the header; metadata lines stand before it"));
      }
      if (auto row = read_any_row(text); !row) return row;
    }
    at = next;
    if (!keep_row()) return tl::unexpected(bad_row());
  }
  return {};
}

/// Rows are reserved as counted, but never more than the limit nor for a file that is refused anyway.
void CsvParser::reserve(std::size_t rows) {
  for (PlannedColumn& column : plan_) column.channel.values.reserve(std::min(rows, kMaxRows));
}

Result<void> CsvParser::read_header(std::string_view text) {
  separator_ = ',';
  for (const char candidate : {';', '\t'}) {
    if (text.find(candidate) != std::string_view::npos) {
      separator_ = candidate;
      break;
    }
  }
  decimal_ = separator_ == ',' ? '.' : '\0';
  FieldSplitter fields(text, separator_);
  for (auto field = fields.next(); field; field = fields.next()) {
    names_.emplace_back(*field);
    if (names_.size() > kMaxColumns) return fail("too_large", fmt::format("more than {} columns", kMaxColumns));
    if (field->size() > kMaxColumnNameBytes) {
      return fail("too_large", fmt::format("a column name of more than {} bytes", kMaxColumnNameBytes));
    }
  }
  auto plan = plan_columns(names_, mapping_);
  if (!plan) return tl::unexpected(plan.error());
  plan_ = std::move(*plan);
  place_.assign(names_.size(), kSkipped);
  for (std::size_t i = 0; i < plan_.size(); ++i) place_[plan_[i].index] = static_cast<int>(i);
  row_.assign(plan_.size(), 0.0);
  for (PlannedColumn& column : plan_) targets_.push_back(&column.channel.values);
  has_time_ = plan_.front().role == ColumnRole::kTime;
  reserve(expected_rows_ > line_ ? expected_rows_ - line_ : 0);
  return {};
}

Result<void> CsvParser::read_head_line(std::string_view text) {
  if (!is_clean_utf8(text)) {
    Error error{.code = "bad_text", .message = fmt::format("'{}' {}", shown(text), unclean_words(text))};
    error.found = shown(text);
    error.expected = "UTF-8 text without control characters";
    return tl::unexpected(error);
  }
  if (!trim(text).starts_with('#')) return read_header(text);
  metadata_bytes_ += text.size();
  if (metadata_bytes_ > kMaxMetadataBytes) {
    return fail("too_large", fmt::format("more than {} bytes of metadata", kMaxMetadataBytes));
  }
  return parse_metadata_line(raw_.metadata, text);
}

Result<RawRecording> CsvParser::parse(std::optional<std::size_t> expected_lines) {
  expected_rows_ = expected_lines.value_or(0);
  for (bool first = true;; first = false) {
    const auto block = lines_.next_block();
    if (!block)
      return tl::unexpected(block.error().code == "too_large" ? at_line(block.error(), line_ + 1) : block.error());
    if (block->empty()) break;
    std::string_view rest = *block;
    if (first && rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
    while (names_.empty() && !rest.empty()) {
      ++line_;
      const std::size_t end = rest.find('\n');
      const std::string_view text = without_carriage_return(rest.substr(0, end));
      rest.remove_prefix(end + 1);
      if (trim(text).empty()) continue;
      if (auto head = read_head_line(text); !head) return tl::unexpected(at_line(head.error(), line_));
    }
    if (auto rows = read_rows(rest.data(), rest.data() + rest.size()); !rows) return tl::unexpected(rows.error());
  }
  if (rows_ == 0) return fail("no_samples", names_.empty() ? "no header and no samples" : "a header and no samples");
  if (rows_ < kMinSamples) {
    return fail("too_few_samples", fmt::format("{} samples, at least {} are needed", rows_, kMinSamples));
  }
  place_channels(std::move(plan_), raw_);
  return std::move(raw_);
}

}  // namespace

Result<RawRecording> parse_csv(ByteSource& source, const std::string& name, const ColumnMapping& mapping) {
  const auto lines = count_lines(source);
  const auto with_name = [&](Error error) {
    error.file = name;
    return tl::unexpected(std::move(error));
  };
  if (!lines) return with_name(lines.error());
  auto raw = CsvParser(source, name, mapping).parse(*lines);
  if (!raw) return with_name(raw.error());
  return raw;
}

}  // namespace valvetriage
