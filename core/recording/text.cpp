#include "core/recording/text.h"

#include <fmt/format.h>

#include <cstdint>

namespace valvetriage {
namespace {

constexpr std::size_t kShownBytes = 40;

unsigned char byte_at(std::string_view text, std::size_t i) {
  return static_cast<unsigned char>(text[i]);
}

/// Length of the well-formed UTF-8 sequence at `i`, 0 where there is none (overlong forms, surrogates, beyond
/// U+10FFFF).
std::size_t sequence_length(std::string_view text, std::size_t i) {
  const unsigned char lead = byte_at(text, i);
  if (lead < 0x80) return 1;
  const std::size_t length = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : lead >= 0xC0 ? 2 : 0;
  if (length == 0 || i + length > text.size()) return 0;
  std::uint32_t code = lead & (0x7Fu >> length);
  for (std::size_t k = 1; k < length; ++k) {
    const unsigned char next = byte_at(text, i + k);
    if ((next & 0xC0) != 0x80) return 0;
    code = (code << 6) | (next & 0x3Fu);
  }
  constexpr std::uint32_t kSmallest[] = {0, 0, 0x80, 0x800, 0x10000};
  const bool surrogate = code >= 0xD800 && code <= 0xDFFF;
  return code < kSmallest[length] || surrogate || code > 0x10FFFF ? 0 : length;
}

bool is_control(unsigned char c) {
  return (c < 0x20 && c != '\t') || c == 0x7F;
}

}  // namespace

std::string_view trim(std::string_view text) {
  constexpr std::string_view kBlank = " \t\r";
  const std::size_t first = text.find_first_not_of(kBlank);
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(kBlank) - first + 1);
}

std::size_t first_unclean(std::string_view text) {
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t length = sequence_length(text, i);
    if (length == 0 || is_control(byte_at(text, i))) return i;
    i += length;
  }
  return std::string_view::npos;
}

bool is_clean_utf8(std::string_view text) {
  return first_unclean(text) == std::string_view::npos;
}

std::string_view unclean_words(std::string_view text) {
  const std::size_t at = first_unclean(text);
  if (at == std::string_view::npos) return "is clean";
  if (text.starts_with("PK\x03\x04")) return "is a zip file, as Excel's workbooks are: save the sheet as CSV";
  if (byte_at(text, at) == '\r') return "has a carriage return inside a line: lines end in LF or CRLF";
  if (is_control(byte_at(text, at))) return "has a control character";
  return "is not UTF-8 text: save the file as UTF-8";
}

std::string shown(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size();) {
    if (out.size() >= kShownBytes) return out + "...";
    const std::size_t length = sequence_length(text, i);
    if (length == 0 || is_control(byte_at(text, i))) {
      out += fmt::format("\\x{:02x}", byte_at(text, i));
      ++i;
    } else {
      out += text.substr(i, length);
      i += length;
    }
  }
  return out;
}

std::string to_lower_ascii(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return lower;
}

}  // namespace valvetriage
