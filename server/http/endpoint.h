#pragma once

#include <string>

#include "core/result.h"

namespace valvetriage::http {

/// Where a server listens or a client connects: "127.0.0.1:8080", "[::1]:8080", "localhost:8080" or "unix:PATH".
struct Endpoint {
  std::string host;
  int port = 0;
  std::string socket_path;  ///< a UNIX socket where not empty

  bool is_unix() const { return !socket_path.empty(); }
  /// "http://127.0.0.1:8080" or "unix:PATH".
  std::string url() const;
};

/// Errors  `bad_parameter` with what was expected
Result<Endpoint> parse_endpoint(const std::string& text);

/// A socket that listens, closed at the end; a UNIX socket's file goes with it.
class Listener {
 public:
  /// Binds and listens. Port 0 lets the system choose; `endpoint().port` then tells. The port is never shared with
  /// another process: a second copy gets an error.
  ///
  /// Errors  `address_in_use`, `cannot_listen`, each with a sentence that says what to do
  static Result<Listener> open(const Endpoint& endpoint);

  Listener(Listener&& other) noexcept;
  Listener& operator=(Listener&&) = delete;
  ~Listener();

  int descriptor() const { return descriptor_; }
  const Endpoint& endpoint() const { return endpoint_; }
  /// Only this machine can reach it: a loopback address or a UNIX socket.
  bool is_local() const { return local_; }

 private:
  Listener(int descriptor, Endpoint endpoint, bool local);
  int descriptor_ = -1;
  Endpoint endpoint_;
  bool local_ = false;
};

}  // namespace valvetriage::http
