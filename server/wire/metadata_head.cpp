#include "server/wire/metadata_head.h"

#include "core/recording/metadata.h"
#include "core/recording/text.h"
#include "server/wire/json.h"

namespace valvetriage {
namespace {

/// Takes the members of the top-level object's `metadata` and stops at its end, at `columns` or where the text ends.
class MetadataListener : public nlohmann::json_sax<Json> {
 public:
  Result<Metadata> result() && { return error_ ? Result<Metadata>(tl::unexpected(*error_)) : std::move(metadata_); }

  bool key(string_t& name) override {
    if (depth_ == 1 && name == "columns") return false;
    if (depth_ == 1) inside_ = name == "metadata";
    key_ = name;
    return true;
  }
  bool string(string_t& value) override { return take(value); }
  bool number_integer(number_integer_t value) override { return take(std::to_string(value)); }
  bool number_unsigned(number_unsigned_t value) override { return take(std::to_string(value)); }
  bool number_float(number_float_t, const string_t& as_written) override { return take(as_written); }
  bool null() override { return true; }
  bool boolean(bool) override { return true; }
  bool binary(binary_t&) override { return true; }
  bool start_object(std::size_t) override { return ++depth_ <= kMaxJsonDepth; }
  bool end_object() override { return --depth_ != 1 || !inside_; }
  bool start_array(std::size_t) override { return ++depth_ <= kMaxJsonDepth; }
  bool end_array() override {
    --depth_;
    return true;
  }
  bool parse_error(std::size_t, const std::string&, const nlohmann::detail::exception&) override { return false; }

 private:
  bool take(const std::string& value) {
    if (depth_ != 2 || !inside_ || value.empty()) return true;
    if (auto set = set_metadata(metadata_, key_, value); !set) {
      error_ = set.error();
      error_->field = "/metadata/" + key_;
      return false;
    }
    return true;
  }

  Metadata metadata_;
  std::optional<Error> error_;
  std::string key_;
  int depth_ = 0;
  bool inside_ = false;
};

bool starts_like_json(std::string_view bytes) {
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.remove_prefix(3);
  const auto first = bytes.find_first_not_of(" \t\r\n");
  return first != std::string_view::npos && bytes[first] == '{';
}

}  // namespace

Result<Metadata> metadata_head(std::string_view first_bytes) {
  first_bytes = first_bytes.substr(0, kMetadataHeadBytes);
  if (!starts_like_json(first_bytes)) return read_metadata_head(first_bytes);
  MetadataListener listener;
  Json::sax_parse(first_bytes, &listener);
  return std::move(listener).result();
}

}  // namespace valvetriage
