#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/result.h"

namespace valvetriage::http {

/// How the body of a request is delimited.
enum class Framing : std::uint8_t { kNone, kLength, kChunked };

/// The head of one HTTP/1.x request, read strictly: what two readers could take differently is refused.
struct RequestHead {
  std::string method;                                        ///< upper case, as sent
  std::vector<std::string> path;                             ///< percent-decoded segments; "/" has none
  std::string path_text;                                     ///< the path as sent, without the query
  std::vector<std::pair<std::string, std::string>> query;    ///< percent-decoded
  std::vector<std::pair<std::string, std::string>> headers;  ///< names in lower case, values trimmed, never decoded
  Framing framing = Framing::kNone;
  std::uint64_t content_length = 0;
  bool keep_alive = true;
  bool expects_continue = false;

  /// First value of a header (name in lower case) or of a query parameter; nothing where it is absent.
  std::optional<std::string_view> header(std::string_view name) const;
  std::optional<std::string_view> parameter(std::string_view name) const;
};

/// Parses the bytes up to and including the empty line.
///
/// Errors  `malformed_request` (bare LF, folded line, control character also after percent-decoding, no or two Hosts,
///         bad or repeated Content-Length, Content-Length with Transfer-Encoding), `unsupported_transfer_coding`,
///         `unsupported_http_version`, `too_many_headers`, `head_too_large`
Result<RequestHead> parse_request_head(std::string_view bytes);

/// Percent-decodes; '+' becomes a space where `plus_is_space`. Nothing for a broken escape.
std::optional<std::string> percent_decode(std::string_view text, bool plus_is_space = false);
/// Percent-encodes everything but unreserved characters.
std::string percent_encode(std::string_view text);

/// Whether a text holds a byte below 0x20 (a tab counts unless allowed) or 0x7f.
bool has_control_character(std::string_view text, bool tab_allowed = false);

}  // namespace valvetriage::http
