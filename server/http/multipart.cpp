#include "server/http/multipart.h"

#include <algorithm>
#include <array>
#include <cstring>

#include "core/recording/text.h"
#include "server/http/limits.h"

namespace valvetriage::http {
namespace {

constexpr std::size_t kReadBytes = 64 * 1024;
constexpr std::size_t kMaxBoundaryBytes = 70;  // RFC 2046

tl::unexpected<Error> malformed(const char* what) {
  return fail("malformed_multipart", what);
}

/// Value of a parameter of a header, quoted or not: `name="a;b"`. A backslash escapes only a quote, since browsers send
/// Windows paths with bare ones.
std::optional<std::string> header_parameter(std::string_view header, std::string_view name) {
  std::size_t at = header.find(';');
  while (at != std::string_view::npos) {
    ++at;
    const auto equals = header.find('=', at);
    if (equals == std::string_view::npos) return std::nullopt;
    const std::string key = to_lower_ascii(trim(header.substr(at, equals - at)));
    std::string value;
    at = equals + 1;
    if (at < header.size() && header[at] == '"') {
      for (++at; at < header.size() && header[at] != '"'; ++at) {
        if (header[at] == '\\' && at + 1 < header.size() && header[at + 1] == '"') ++at;
        value.push_back(header[at]);
      }
      at = header.find(';', at);
    } else {
      const auto end = header.find(';', at);
      value = trim(header.substr(at, end == std::string_view::npos ? end : end - at));
      at = end;
    }
    if (key == name) return value;
  }
  return std::nullopt;
}

Result<PartHead> parse_part_head(std::string_view text) {
  PartHead head;
  bool is_form_data = false;
  while (!text.empty()) {
    const auto end = text.find("\r\n");
    const std::string_view line = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 2);
    const auto colon = line.find(':');
    if (colon == std::string_view::npos) return malformed("a part's header line is not 'Name: value'");
    if (to_lower_ascii(trim(line.substr(0, colon))) != "content-disposition") continue;
    const std::string_view value = trim(line.substr(colon + 1));
    is_form_data = to_lower_ascii(value).starts_with("form-data");
    head.name = header_parameter(value, "name").value_or("");
    head.file_name = header_parameter(value, "filename").value_or("");
  }
  if (!is_form_data || head.name.empty()) return malformed("a part has no 'Content-Disposition: form-data; name=...'");
  const auto slash = head.file_name.find_last_of("/\\");
  if (slash != std::string::npos) head.file_name.erase(0, slash + 1);
  return head;
}

}  // namespace

MultipartReader::MultipartReader(ByteSource& body, const std::string& boundary)
    : body_(body), delimiter_("\r\n--" + boundary), buffer_("\r\n") {}

Result<bool> MultipartReader::fill() {
  const std::size_t before = buffer_.size();
  buffer_.resize(before + kReadBytes);
  const auto n = body_.read(std::span(buffer_).subspan(before));
  buffer_.resize(before + n.value_or(0));
  if (!n) return tl::unexpected(n.error());
  return *n != 0;
}

Result<std::string> MultipartReader::take_until(std::string_view mark, std::size_t max_bytes) {
  for (;;) {
    const auto found = buffer_.find(mark);
    if (found != std::string::npos && found <= max_bytes) {
      std::string taken = buffer_.substr(0, found);
      buffer_.erase(0, found + mark.size());
      return taken;
    }
    if (buffer_.size() > max_bytes) return malformed("a part's header is too long");
    const auto more = fill();
    if (!more) return tl::unexpected(more.error());
    if (!*more) return malformed("the body ends inside a part");
  }
}

Result<std::optional<PartHead>> MultipartReader::next() {
  std::array<char, 4096> skipped;
  while (in_part_) {
    const auto n = read(skipped);
    if (!n) return tl::unexpected(n.error());
  }
  if (ended_) return std::nullopt;
  const auto rest_of_line = take_until("\r\n", kMaxMultipartHeaderBytes);
  if (!rest_of_line) {
    // "--boundary--" may end the body without a line end.
    if (buffer_.starts_with("--")) {
      ended_ = true;
      return std::nullopt;
    }
    return tl::unexpected(rest_of_line.error());
  }
  if (rest_of_line->starts_with("--")) {
    ended_ = true;
    return std::nullopt;
  }
  if (!trim(*rest_of_line).empty()) return malformed("a boundary line has more on it than the boundary");
  const auto text = take_until("\r\n\r\n", kMaxMultipartHeaderBytes);
  if (!text) return tl::unexpected(text.error());
  auto head = parse_part_head(*text);
  if (!head) return tl::unexpected(head.error());
  in_part_ = true;
  return std::move(*head);
}

Result<std::size_t> MultipartReader::read(std::span<char> into) {
  if (!in_part_ || into.empty()) return 0;
  for (;;) {
    const auto found = buffer_.find(delimiter_);
    const bool whole = found != std::string::npos;
    // What could be the beginning of a delimiter stays.
    const std::size_t keep = delimiter_.size() - 1;
    std::size_t usable = whole ? found : buffer_.size() > keep ? buffer_.size() - keep : 0;
    if (whole && found == 0) {
      buffer_.erase(0, delimiter_.size());
      in_part_ = false;
      return 0;
    }
    if (usable != 0) {
      const std::size_t n = std::min(usable, into.size());
      std::memcpy(into.data(), buffer_.data(), n);
      buffer_.erase(0, n);
      return n;
    }
    const auto more = fill();
    if (!more) return tl::unexpected(more.error());
    if (!*more) return malformed("the body ends inside a part");
  }
}

std::optional<std::string> multipart_boundary(std::string_view content_type) {
  if (!to_lower_ascii(content_type).starts_with("multipart/form-data")) return std::nullopt;
  auto boundary = header_parameter(content_type, "boundary");
  if (!boundary || boundary->empty() || boundary->size() > kMaxBoundaryBytes) return std::nullopt;
  return boundary;
}

}  // namespace valvetriage::http
