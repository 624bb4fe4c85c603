#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/recording/parse_csv.h"
#include "server/http/request_head.h"

namespace valvetriage::http {

/// One request as a handler sees it. Nothing in here is more than the client's word except `actor` and `client`.
struct Request {
  RequestHead head;
  std::vector<std::string> captures;  ///< what stood at the `{}` of the route's pattern
  ByteSource* body = nullptr;         ///< bytes as sent (de-chunked, still encoded); never null, read at most once
  std::string id;                     ///< request id, also in the answer and the log
  std::string client;                 ///< address of the peer, "unix" for a local socket
  std::string actor;                  ///< who: a token's name, or "local" where none is asked for

  /// Query parameter, empty where absent.
  std::string parameter(std::string_view name) const { return std::string(head.parameter(name).value_or("")); }
};

/// Sends a body piece by piece; false when the client has gone.
using Sink = std::function<bool(std::string_view)>;

/// One answer. Either `body`, or `stream` with its exact length.
struct Response {
  int status = 200;
  std::string content_type = "application/json";
  std::vector<std::pair<std::string, std::string>> headers;
  std::string body;
  std::uint64_t stream_length = 0;
  std::function<bool(const Sink&)> stream;

  void set_header(std::string name, std::string value) { headers.emplace_back(std::move(name), std::move(value)); }
};

}  // namespace valvetriage::http
