#include "server/wire/json_recording.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <optional>
#include <vector>

#include "core/recording/columns.h"
#include "core/recording/limits.h"
#include "core/recording/metadata.h"
#include "core/recording/text.h"
#include "server/wire/json.h"

namespace valvetriage {
namespace {

/// Characters of a source one by one, with their place in the text.
class CharacterStream {
 public:
  explicit CharacterStream(ByteSource& source) : source_(source) { advance(); }

  bool at_end() const { return at_end_; }
  char current() const { return buffer_[at_]; }
  void advance() {
    if (started_ && !at_end_) {
      column_ = current() == '\n' ? 1 : column_ + 1;
      line_ += current() == '\n';
      ++at_;
    }
    started_ = true;
    if (at_ < size_ || at_end_) return;
    const auto got = source_.read(buffer_);
    if (!got) error_ = got.error();
    size_ = got ? *got : 0;
    at_ = 0;
    at_end_ = size_ == 0;
  }
  std::size_t line() const { return line_; }
  std::size_t column() const { return column_; }
  const std::optional<Error>& error() const { return error_; }

 private:
  ByteSource& source_;
  std::array<char, 65'536> buffer_{};
  std::size_t at_ = 0, size_ = 0;
  std::size_t line_ = 1, column_ = 1;
  bool started_ = false, at_end_ = false;
  std::optional<Error> error_;
};

/// The stream as the input iterator that the JSON library reads from.
class CharacterIterator {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = char;

  explicit CharacterIterator(CharacterStream* stream) : stream_(stream) {}
  char operator*() const { return stream_->current(); }
  CharacterIterator& operator++() {
    stream_->advance();
    return *this;
  }
  bool operator==(const CharacterIterator& other) const { return is_end() == other.is_end(); }
  bool operator!=(const CharacterIterator& other) const { return !(*this == other); }

 private:
  bool is_end() const { return stream_ == nullptr || stream_->at_end(); }
  CharacterStream* stream_;
};

std::string pointer_token(std::string_view name) {
  std::string token;
  for (const char c : shown(name)) token += c == '~' ? "~0" : c == '/' ? "~1" : std::string(1, c);
  return token;
}

/// Fills a RawRecording from the events of the JSON reader. The place in the document is one of the states; every
/// value that is deeper than a column's numbers is refused where it opens, so nothing recurses.
class RecordingEvents : public nlohmann::json_sax<nlohmann::json> {
 public:
  RecordingEvents(const CharacterStream& stream, const ColumnMapping& mapping) : stream_(stream), mapping_(mapping) {}

  bool null() override { return place_ == Place::kMetadata || value("null", std::nullopt); }
  bool boolean(bool b) override { return value(b ? "true" : "false", std::nullopt); }
  bool number_integer(number_integer_t v) override { return value(fmt::format("{}", v), static_cast<double>(v)); }
  bool number_unsigned(number_unsigned_t v) override { return value(fmt::format("{}", v), static_cast<double>(v)); }
  bool number_float(number_float_t v, const string_t& text) override { return value(text, v); }
  bool string(string_t& text) override { return value(text, std::nullopt); }
  bool binary(binary_t&) override { return refuse("malformed_json", "binary", "a number"); }

  bool start_object(std::size_t) override {
    switch (place_) {
      case Place::kOutside:
        place_ = Place::kTop;
        return true;
      case Place::kTop:
        return open_member();
      default:
        return refuse(place_ == Place::kMetadata ? "bad_metadata" : "not_a_number", "{", expected_here());
    }
  }
  bool end_object() override {
    place_ = place_ == Place::kTop ? Place::kOutside : Place::kTop;
    return true;
  }
  bool start_array(std::size_t) override {
    if (place_ != Place::kColumns) return refuse("malformed_recording", "[", expected_here());
    place_ = Place::kColumn;
    return true;
  }
  bool end_array() override {
    place_ = Place::kColumns;
    return true;
  }
  bool key(string_t& name) override {
    key_ = name;
    return place_ == Place::kColumns ? open_column() : true;
  }
  bool parse_error(std::size_t, const std::string& last_token, const nlohmann::json::exception& problem) override {
    constexpr int kNumberOverflow = 406;
    const bool literal = last_token.ends_with('N') || last_token.ends_with('I');
    if (problem.id == kNumberOverflow || literal) {
      // What was read may begin with the token before.
      return refuse("not_finite", last_token.substr(last_token.find_last_of("[,: \t\r\n") + 1), "a finite number");
    }
    return refuse("malformed_json", stream_.at_end() ? "the end of the text" : last_token, "JSON");
  }

  Result<RawRecording> finish(const std::string& name);
  const std::optional<Error>& error() const { return error_; }

 private:
  enum class Place { kOutside, kTop, kMetadata, kColumns, kColumn };

  std::string pointer() const {
    switch (place_) {
      case Place::kOutside:
        return "";
      case Place::kTop:
        return "/" + pointer_token(key_);
      case Place::kMetadata:
        return key_.empty() ? "/metadata" : "/metadata/" + pointer_token(key_);
      case Place::kColumns:
        return key_.empty() ? "/columns" : "/columns/" + pointer_token(key_);
      case Place::kColumn:
        return fmt::format("/columns/{}/{}", pointer_token(key_), count_);
    }
    return "";
  }

  std::string expected_here() const {
    switch (place_) {
      case Place::kOutside:
        return "an object with metadata and columns";
      case Place::kTop:
        return "an object";
      case Place::kMetadata:
        return "a text or a number";
      case Place::kColumns:
        return "an array of numbers";
      case Place::kColumn:
        return "a number";
    }
    return "";
  }

  bool refuse(std::string code, std::string_view found, std::string expected) {
    Error error{.code = std::move(code)};
    error.line = stream_.line();
    error.column = stream_.column();
    error.field = pointer();
    error.found = shown(found);
    error.message = fmt::format("line {}, column {}{}{}: found '{}', expected {}", stream_.line(), stream_.column(),
                                error.field.empty() ? "" : " ", error.field, error.found, expected);
    error.expected = std::move(expected);
    return stop(std::move(error));
  }

  bool stop(Error error) {
    if (!error_) error_ = std::move(error);
    return false;
  }

  bool open_member() {
    if (key_ != "metadata" && key_ != "columns") return refuse("unknown_key", key_, "metadata or columns");
    bool& seen = key_ == "metadata" ? seen_metadata_ : seen_columns_;
    if (seen) return refuse("duplicate_key", key_, "each key once");
    seen = true;
    place_ = key_ == "metadata" ? Place::kMetadata : Place::kColumns;
    key_.clear();
    return true;
  }

  bool open_column() {
    if (key_.size() > kMaxColumnNameBytes || names_.size() >= kMaxColumns) {
      return refuse("too_large", key_,
                    fmt::format("at most {} columns with names of at most {} bytes", kMaxColumns, kMaxColumnNameBytes));
    }
    if (std::ranges::find(names_, key_) != names_.end()) return refuse("duplicate_column", key_, "each column once");
    names_.push_back(key_);
    values_.emplace_back();
    wanted_ = may_be_planned(key_, mapping_);
    count_ = 0;
    return true;
  }

  bool value(std::string_view text, std::optional<double> number) {
    if (place_ == Place::kMetadata) {
      if (text.empty()) return true;
      if (auto set = set_metadata(metadata_, key_, text); !set) {
        Error error = set.error();
        error.line = stream_.line();
        error.field = pointer();
        return stop(std::move(error));
      }
      return true;
    }
    if (place_ != Place::kColumn) return refuse("malformed_recording", text, expected_here());
    if (wanted_ && !number) return refuse("not_a_number", text, expected_here());
    if (count_ == kMaxRows) return refuse("too_large", text, fmt::format("at most {} samples", kMaxRows));
    if (wanted_) values_.back().push_back(*number);
    ++count_;
    return true;
  }

  const CharacterStream& stream_;
  const ColumnMapping& mapping_;
  Place place_ = Place::kOutside;
  std::string key_;
  bool seen_metadata_ = false, seen_columns_ = false;
  bool wanted_ = false;
  std::size_t count_ = 0;  ///< values of the open column
  Metadata metadata_;
  std::vector<std::string> names_;
  std::vector<std::vector<double>> values_;  ///< one per name, empty where not wanted
  std::optional<Error> error_;
};

tl::unexpected<Error> column_error(std::string code, const std::string& pointer, std::string found,
                                   std::string expected) {
  Error error{.code = std::move(code)};
  error.field = pointer;
  error.message = fmt::format("{}: found {}, expected {}", pointer, found, expected);
  error.found = std::move(found);
  error.expected = std::move(expected);
  return tl::unexpected(error);
}

Result<void> check_columns(const std::vector<PlannedColumn>& plan) {
  const Channel& first = plan.front().channel;
  for (const PlannedColumn& column : plan) {
    const Channel& channel = column.channel;
    const std::string pointer = "/columns/" + pointer_token(channel.name);
    if (channel.values.size() != first.values.size()) {
      return column_error("ragged_columns", pointer, fmt::format("{} values", channel.values.size()),
                          fmt::format("{} as in {}", first.values.size(), first.name));
    }
    if (column.role != ColumnRole::kTime) continue;
    const auto at = std::ranges::adjacent_find(channel.values, std::greater_equal{});
    if (at == channel.values.end()) continue;
    return column_error("time_not_increasing", fmt::format("{}/{}", pointer, at + 1 - channel.values.begin()),
                        fmt::format("{}", *(at + 1)), fmt::format("a time after {}", *at));
  }
  return {};
}

Result<RawRecording> RecordingEvents::finish(const std::string& name) {
  if (!seen_columns_) return column_error("missing_column", "/columns", "nothing", "an object of columns");
  auto plan = plan_columns(names_, mapping_);
  if (!plan) return tl::unexpected(plan.error());
  for (PlannedColumn& column : *plan) column.channel.values = std::move(values_[column.index]);
  if (auto checked = check_columns(*plan); !checked) return tl::unexpected(checked.error());
  RawRecording raw;
  raw.name = name;
  raw.metadata = std::move(metadata_);
  place_channels(std::move(*plan), raw);
  return raw;
}

Result<RawRecording> parse(ByteSource& source, const std::string& name, const ColumnMapping& mapping) {
  CharacterStream stream(source);
  RecordingEvents events(stream, mapping);
  const bool whole = nlohmann::json::sax_parse(CharacterIterator(&stream), CharacterIterator(nullptr), &events);
  if (stream.error()) return tl::unexpected(*stream.error());
  if (events.error()) return tl::unexpected(*events.error());
  if (!whole) return fail("malformed_json", "the text is not JSON");
  return events.finish(name);
}

}  // namespace

Json metadata_json(const Metadata& metadata) {
  Json object = Json::object();
  for (const MetadataKey& key : metadata_keys()) {
    if (const auto& value = metadata.*key.field) object[std::string(key.name)] = *value;
  }
  for (const auto& [name, value] : metadata.others) object[name] = value;
  return object;
}

Result<RawRecording> parse_json_recording(ByteSource& source, const std::string& name, const ColumnMapping& mapping) {
  auto raw = parse(source, name, mapping);
  if (raw) return raw;
  Error error = raw.error();
  error.file = name;
  return tl::unexpected(std::move(error));
}

}  // namespace valvetriage
