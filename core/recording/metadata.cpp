#include "core/recording/metadata.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "core/recording/limits.h"
#include "core/recording/text.h"

namespace valvetriage {
namespace {

constexpr std::array<MetadataKey, 11> kKeys{{{"serial", &Metadata::serial},
                                             {"lot", &Metadata::lot},
                                             {"valve_type", &Metadata::valve_type},
                                             {"condition", &Metadata::condition},
                                             {"test", &Metadata::test},
                                             {"stand", &Metadata::stand},
                                             {"tested_at", &Metadata::tested_at},
                                             {"operator", &Metadata::operator_name},
                                             {"claim", &Metadata::claim},
                                             {"complaint", &Metadata::complaint},
                                             {"hours", &Metadata::hours}}};

constexpr std::array<std::string_view, 4> kConditions{"new", "returned", "prototype", "unknown"};

tl::unexpected<Error> bad_metadata(std::string_view key, std::string_view found, std::string expected) {
  Error error{.code = "bad_metadata"};
  error.field = shown(key);
  error.found = shown(found);
  error.expected = std::move(expected);
  error.message = fmt::format("metadata {}: found '{}', expected {}", error.field, error.found, error.expected);
  return tl::unexpected(error);
}

Result<void> check_value(std::string_view key, std::string_view value) {
  if (key.size() > kMaxMetadataKeyBytes || !is_clean_utf8(key)) {
    return bad_metadata(key, key, fmt::format("a key of at most {} bytes of UTF-8", kMaxMetadataKeyBytes));
  }
  if (value.size() > kMaxMetadataValueBytes || !is_clean_utf8(value)) {
    return bad_metadata(key, value, fmt::format("at most {} bytes of UTF-8 text", kMaxMetadataValueBytes));
  }
  if (key == "test" && !test_kind_from(std::string(value))) {
    return bad_metadata(key, value, "step, staircase, triangle, sweep or other");
  }
  if (key == "condition" && std::ranges::find(kConditions, value) == kConditions.end()) {
    return bad_metadata(key, value, "new, returned, prototype or unknown");
  }
  return {};
}

std::size_t pair_count(const Metadata& metadata) {
  const auto set =
      std::ranges::count_if(kKeys, [&](const MetadataKey& key) { return (metadata.*key.field).has_value(); });
  return metadata.others.size() + static_cast<std::size_t>(set);
}

tl::unexpected<Error> duplicate(std::string_view key, std::string_view value) {
  Error error{.code = "duplicate_metadata"};
  error.field = shown(key);
  error.found = shown(value);
  error.expected = "each key once";
  error.message = fmt::format("metadata {}: stands twice, the second time as '{}'", error.field, error.found);
  return tl::unexpected(error);
}

bool is_letter(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}
bool is_key_character(char c) {
  return is_letter(c) || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '.';
}
bool is_blank(char c) {
  return c == ' ' || c == '\t';
}

/// The key that `text` starts with, where a colon follows it; empty where `text` starts no pair.
std::string_view leading_key(std::string_view text) {
  if (text.empty() || !is_letter(text.front())) return {};
  std::size_t end = 1;
  while (end < text.size() && is_key_character(text[end])) ++end;
  std::size_t colon = end;
  while (colon < text.size() && is_blank(text[colon])) ++colon;
  return colon < text.size() && text[colon] == ':' ? text.substr(0, end) : std::string_view{};
}

/// Where the part that starts at `begin` ends: before a ` #` that starts another pair or a comment, else at the end.
std::size_t end_of_part(std::string_view text, std::size_t begin) {
  for (std::size_t i = begin; i < text.size(); ++i) {
    if (text[i] != '#' || i == 0 || !is_blank(text[i - 1])) continue;
    const std::string_view rest = text.substr(i + 1);
    if (rest.empty() || is_blank(rest.front()) || !leading_key(rest).empty()) return i;
  }
  return text.size();
}

std::string_view without_remark(std::string_view value) {
  for (std::size_t i = 2; i < value.size(); ++i) {
    if (value[i] == '(' && is_blank(value[i - 1]) && is_blank(value[i - 2])) return trim(value.substr(0, i));
  }
  return value;
}

}  // namespace

std::span<const MetadataKey> metadata_keys() {
  return kKeys;
}

Result<void> set_metadata(Metadata& metadata, std::string_view key, std::string_view value) {
  const std::string name = to_lower_ascii(key);
  if (auto checked = check_value(name, value); !checked) return checked;
  if (pair_count(metadata) >= kMaxMetadataPairs) {
    return bad_metadata(name, value, fmt::format("at most {} pairs", kMaxMetadataPairs));
  }
  for (const MetadataKey& known : kKeys) {
    if (known.name != name) continue;
    if (metadata.*known.field) return duplicate(name, value);
    metadata.*known.field = std::string(value);
    return {};
  }
  if (!metadata.others.emplace(name, value).second) return duplicate(name, value);
  return {};
}

Result<void> parse_metadata_line(Metadata& metadata, std::string_view line) {
  std::string_view rest = trim(line);
  while (!rest.empty()) {
    rest = trim(
        rest.substr(rest.find_first_not_of('#') == std::string_view::npos ? rest.size() : rest.find_first_not_of('#')));
    const std::size_t end = end_of_part(rest, 0);
    const std::string_view part = trim(rest.substr(0, end));
    rest.remove_prefix(end);
    const std::string_view key = leading_key(part);
    if (key.empty()) continue;
    const std::string_view after_colon = part.substr(part.find(':') + 1);
    const std::string_view value = without_remark(trim(after_colon));
    if (value.empty()) continue;
    if (auto set = set_metadata(metadata, key, value); !set) return set;
  }
  return {};
}

Result<Metadata> read_metadata_head(std::string_view first_bytes) {
  Metadata metadata;
  std::string_view rest = first_bytes.substr(0, kMaxMetadataBytes);
  if (rest.starts_with("\xEF\xBB\xBF")) rest.remove_prefix(3);
  for (std::size_t line = 1;; ++line) {
    const std::size_t end = rest.find('\n');
    if (end == std::string_view::npos) return metadata;
    const std::string_view text = trim(rest.substr(0, end));
    rest.remove_prefix(end + 1);
    if (text.empty()) continue;
    if (text.front() != '#') return metadata;
    if (auto parsed = parse_metadata_line(metadata, text); !parsed) {
      Error error = parsed.error();
      error.line = line;
      error.message = fmt::format("line {}: {}", line, error.message);
      return tl::unexpected(error);
    }
  }
}

Result<void> apply_metadata_options(Metadata& metadata, const Metadata& options) {
  for (const MetadataKey& key : kKeys) {
    const auto& wanted = options.*key.field;
    if (!wanted) continue;
    auto& stands = metadata.*key.field;
    if (stands && *stands != *wanted) {
      Error error{.code = "contradicting_metadata"};
      error.field = key.name;
      error.found = shown(*stands);
      error.expected = shown(*wanted);
      error.message =
          fmt::format("metadata {}: the file says '{}', the option says '{}'", key.name, error.found, error.expected);
      return tl::unexpected(error);
    }
    if (stands) continue;
    if (auto set = set_metadata(metadata, key.name, *wanted); !set) return set;
  }
  return {};
}

}  // namespace valvetriage
