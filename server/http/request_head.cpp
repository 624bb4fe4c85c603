#include "server/http/request_head.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <limits>

#include "server/http/limits.h"

namespace valvetriage::http {
namespace {

constexpr std::string_view kTokenPunctuation = "!#$%&'*+-.^_`|~";

bool is_alphanumeric(char c) {
  return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z');
}

bool is_token(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) {
    return is_alphanumeric(c) || kTokenPunctuation.find(c) != std::string_view::npos;
  });
}

std::string lower_case(std::string_view text) {
  std::string lower(text);
  for (char& c : lower) {
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  }
  return lower;
}

std::string_view trim(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

bool has_encoded_control_character(std::string_view text) {
  for (auto at = text.find('%'); at != std::string_view::npos; at = text.find('%', at + 1)) {
    const auto decoded = percent_decode(text.substr(at, 3));
    if (decoded && has_control_character(*decoded)) return true;
  }
  return false;
}

tl::unexpected<Error> malformed(std::string what) {
  return fail("malformed_request", std::move(what));
}

/// Cuts the next CRLF line off the front; nothing where a line ends in a bare LF or holds a CR.
std::optional<std::string_view> take_line(std::string_view& rest) {
  const auto end = rest.find("\r\n");
  if (end == std::string_view::npos) return std::nullopt;
  const std::string_view line = rest.substr(0, end);
  rest.remove_prefix(end + 2);
  if (line.find_first_of("\r\n") != std::string_view::npos) return std::nullopt;
  return line;
}

Result<void> parse_path(std::string_view path, RequestHead& head) {
  head.path_text = path;
  while (!path.empty()) {
    path.remove_prefix(1);  // the slash
    const auto slash = path.find('/');
    const auto segment = percent_decode(path.substr(0, slash));
    if (!segment || has_control_character(*segment)) {
      return malformed("the path holds a broken percent escape or a control character");
    }
    if (!segment->empty() || slash != std::string_view::npos) head.path.push_back(*segment);
    path.remove_prefix(slash == std::string_view::npos ? path.size() : slash);
  }
  return {};
}

Result<void> parse_query(std::string_view query, RequestHead& head) {
  while (!query.empty()) {
    const auto end = query.find('&');
    const std::string_view pair = query.substr(0, end);
    query.remove_prefix(end == std::string_view::npos ? query.size() : end + 1);
    if (pair.empty()) continue;
    const auto equals = pair.find('=');
    const auto name = percent_decode(pair.substr(0, equals), true);
    const auto value = equals == std::string_view::npos ? std::string() : percent_decode(pair.substr(equals + 1), true);
    if (!name || !value || has_control_character(*name) || has_control_character(*value)) {
      return malformed("the query holds a broken percent escape or a control character");
    }
    if (head.parameter(*name)) return malformed(fmt::format("the parameter '{}' is given twice", *name));
    head.query.emplace_back(*name, *value);
  }
  return {};
}

Result<void> parse_request_line(std::string_view line, RequestHead& head) {
  const auto first = line.find(' ');
  const auto last = line.rfind(' ');
  if (first == std::string_view::npos || first == last)
    return malformed("the request line is not METHOD TARGET VERSION");
  head.method = line.substr(0, first);
  std::string_view target = line.substr(first + 1, last - first - 1);
  const std::string_view version = line.substr(last + 1);
  if (!is_token(head.method)) return malformed("the method is not a token");
  if (version != "HTTP/1.1" && version != "HTTP/1.0") {
    if (version.starts_with("HTTP/"))
      return fail("unsupported_http_version", "only HTTP/1.1 and HTTP/1.0 are spoken here");
    return malformed("the request line is not METHOD TARGET VERSION");
  }
  head.keep_alive = version == "HTTP/1.1";
  const bool plain = std::all_of(target.begin(), target.end(), [](char c) { return c > ' ' && c < 0x7f && c != '#'; });
  if (!plain) return malformed("the target holds a character that has to be percent-encoded");
  if (target == "*" && head.method == "OPTIONS") target = "/";
  if (!target.starts_with('/')) return malformed("the target has to begin with '/'");
  const auto mark = target.find('?');
  if (auto parsed = parse_path(target.substr(0, mark), head); !parsed) return parsed;
  return mark == std::string_view::npos ? Result<void>() : parse_query(target.substr(mark + 1), head);
}

Result<void> parse_header_line(std::string_view line, RequestHead& head) {
  if (line.front() == ' ' || line.front() == '\t') return malformed("folded header lines are not accepted");
  const auto colon = line.find(':');
  if (colon == std::string_view::npos || !is_token(line.substr(0, colon))) {
    return malformed("a header line is not 'Name: value'");
  }
  const std::string_view value = trim(line.substr(colon + 1));
  if (has_control_character(value, true)) return malformed("a header value holds a control character");
  // Whoever decodes values later on (proxies and libraries do) must not find a line break in them.
  if (has_encoded_control_character(value)) {
    return malformed("a header value holds a percent-encoded control character");
  }
  if (head.headers.size() >= kMaxHeaders) {
    return fail("too_many_headers", fmt::format("the request has more than {} headers", kMaxHeaders));
  }
  head.headers.emplace_back(lower_case(line.substr(0, colon)), value);
  return {};
}

std::size_t count_of(const RequestHead& head, std::string_view name) {
  return static_cast<std::size_t>(std::count_if(head.headers.begin(), head.headers.end(),
                                                [&](const auto& header) { return header.first == name; }));
}

Result<void> settle_framing(RequestHead& head) {
  const auto lengths = count_of(head, "content-length");
  const auto codings = count_of(head, "transfer-encoding");
  if (lengths > 1 || codings > 1) return malformed("Content-Length or Transfer-Encoding stands twice");
  if (lengths == 1 && codings == 1) return malformed("Content-Length and Transfer-Encoding exclude each other");
  if (codings == 1) {
    if (lower_case(*head.header("transfer-encoding")) != "chunked") {
      return fail("unsupported_transfer_coding", "the only Transfer-Encoding accepted is 'chunked'");
    }
    head.framing = Framing::kChunked;
  } else if (lengths == 1) {
    const std::string_view text = *head.header("content-length");
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), head.content_length);
    const bool digits = std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
    if (text.empty() || !digits || error != std::errc() || end != text.data() + text.size()) {
      return malformed("Content-Length is not a number of bytes");
    }
    head.framing = Framing::kLength;
  }
  return {};
}

Result<void> settle_connection(RequestHead& head) {
  if (const auto connection = head.header("connection")) {
    const std::string lower = lower_case(*connection);
    if (lower.find("close") != std::string::npos) head.keep_alive = false;
  }
  if (const auto expect = head.header("expect")) {
    if (lower_case(*expect) != "100-continue")
      return fail("expectation_failed", "the only Expect accepted is '100-continue'");
    head.expects_continue = true;
  }
  return {};
}

}  // namespace

std::optional<std::string_view> RequestHead::header(std::string_view name) const {
  for (const auto& [key, value] : headers) {
    if (key == name) return value;
  }
  return std::nullopt;
}

std::optional<std::string_view> RequestHead::parameter(std::string_view name) const {
  for (const auto& [key, value] : query) {
    if (key == name) return value;
  }
  return std::nullopt;
}

bool has_control_character(std::string_view text, bool tab_allowed) {
  return std::any_of(text.begin(), text.end(), [&](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte == 0x7f || (byte < 0x20 && !(tab_allowed && c == '\t'));
  });
}

std::optional<std::string> percent_decode(std::string_view text, bool plus_is_space) {
  std::string decoded;
  decoded.reserve(text.size());
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%') {
      unsigned value = 0;
      if (i + 2 >= text.size()) return std::nullopt;
      const auto [end, error] = std::from_chars(text.data() + i + 1, text.data() + i + 3, value, 16);
      if (error != std::errc() || end != text.data() + i + 3) return std::nullopt;
      decoded.push_back(static_cast<char>(value));
      i += 2;
    } else {
      decoded.push_back(plus_is_space && text[i] == '+' ? ' ' : text[i]);
    }
  }
  return decoded;
}

std::string percent_encode(std::string_view text) {
  std::string encoded;
  for (const char c : text) {
    if (is_alphanumeric(c) || c == '-' || c == '.' || c == '_' || c == '~') {
      encoded.push_back(c);
    } else {
      encoded += fmt::format("%{:02X}", static_cast<unsigned char>(c));
    }
  }
  return encoded;
}

Result<RequestHead> parse_request_head(std::string_view bytes) {
  if (bytes.size() > kMaxHeadBytes) {
    return fail("head_too_large", fmt::format("the head of the request is larger than {} bytes", kMaxHeadBytes));
  }
  RequestHead head;
  std::string_view rest = bytes;
  const auto request_line = take_line(rest);
  if (!request_line) return malformed("the request line does not end in CR LF");
  if (auto parsed = parse_request_line(*request_line, head); !parsed) return tl::unexpected(parsed.error());
  for (;;) {
    const auto line = take_line(rest);
    if (!line) return malformed("a header line does not end in CR LF");
    if (line->empty()) break;
    if (auto parsed = parse_header_line(*line, head); !parsed) return tl::unexpected(parsed.error());
  }
  if (count_of(head, "host") != 1) return malformed("exactly one Host header is needed");
  if (auto settled = settle_framing(head); !settled) return tl::unexpected(settled.error());
  if (auto settled = settle_connection(head); !settled) return tl::unexpected(settled.error());
  return head;
}

}  // namespace valvetriage::http
