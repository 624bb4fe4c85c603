#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/result.h"

namespace valvetriage::http {

/// An answer of a server, whatever its status.
struct Answer {
  int status = 0;
  std::string body;
  std::optional<int> retry_after_s;
};

/// Files of one upload: sent as parts `file`, each under its name.
struct Upload {
  std::string path;  ///< route with its query
  std::vector<std::string> files;
  std::string idempotency_key;
};

/// A server at http://HOST:PORT or unix:PATH. Not thread-safe.
class Client {
 public:
  /// token  empty: none. Errors  `bad_parameter` for another kind of URL
  static Result<Client> open(const std::string& url, const std::string& token);
  Client(Client&&) noexcept;
  ~Client();

  /// Errors  `no_connection` with the reason
  Result<Answer> get(const std::string& path);
  Result<Answer> post(const std::string& path, const std::string& json);
  Result<Answer> remove(const std::string& path);
  /// Streams the files; `sent` is told how many bytes have gone out. Errors  `no_connection`, `cannot_read`
  Result<Answer> upload(const Upload& upload, const std::function<void(std::uint64_t bytes)>& sent);

 private:
  struct State;
  explicit Client(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// How often and how long a request is tried again.
struct Patience {
  int attempts = 8;
  double first_wait_s = 0.25;  ///< doubles with every attempt
  double longest_wait_s = 30;  ///< also bounds what a server's Retry-After may ask for
};

/// Calls `request` until it is answered with something that waiting does not mend: connection failures, 408, 429, 502,
/// 503 and 504 are tried again after a growing wait with jitter, or after the server's Retry-After. Safe for uploads
/// because they carry an idempotency key.
Result<Answer> with_retries(const Patience& patience, const std::function<Result<Answer>()>& request);

}  // namespace valvetriage::http
