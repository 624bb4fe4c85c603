#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "core/recording/parse_csv.h"
#include "server/http/request_head.h"

namespace valvetriage::http {

using SteadyTime = std::chrono::steady_clock::time_point;

/// One accepted socket, non-blocking, closed at the end. Every wait has a deadline. One thread at a time.
class Connection {
 public:
  Connection(int descriptor, std::string client);
  Connection(Connection&& other) noexcept;
  Connection& operator=(Connection&& other) noexcept;
  ~Connection();

  int descriptor() const { return descriptor_; }
  const std::string& client() const { return client_; }

  /// Takes in what has arrived, without waiting; false when the peer has closed or the socket failed.
  bool fill();
  /// Length of the head in the buffer with its empty line, 0 while it is not whole.
  std::size_t head_size() const;
  std::size_t buffered() const { return buffer_.size() - taken_; }
  /// Bytes in memory, those that were taken and are not let go of yet among them.
  std::size_t held() const { return buffer_.size(); }
  /// Takes the first `size` bytes of the buffer.
  std::string take(std::size_t size);

  /// Up to into.size() bytes, buffered ones first; 0 when the peer has closed. Errors `request_timeout`,
  /// `incomplete_body`.
  Result<std::size_t> read(std::span<char> into, SteadyTime deadline);
  /// All of `bytes`; more time for more bytes (kAnswerGrace, kMinBodyBytesPerSecond). False when the client has gone or
  /// reads too slowly.
  bool write(std::string_view bytes);
  /// Ends a connection whose request was not read whole so that the client still gets the answer.
  void linger();

 private:
  ssize_t receive();

  int descriptor_ = -1;
  std::string client_;
  std::string buffer_;
  std::size_t taken_ = 0;  ///< bytes of the buffer already given out
};

/// The body of one request, framing removed, with a deadline that grows with the bytes received.
class BodySource : public ByteSource {
 public:
  BodySource(Connection& connection, const RequestHead& head);

  /// Errors  `malformed_request` (chunk framing), `request_timeout`, `incomplete_body`
  Result<std::size_t> read(std::span<char> buffer) override;
  bool rewind() override { return false; }

  /// Takes in a small rest that nobody asked for (the last chunk, the end of a multipart body), so that the connection
  /// can go on.
  void drain();

  bool finished() const { return finished_; }
  std::uint64_t received_bytes() const { return received_; }

 private:
  Result<void> next_chunk();
  Result<std::string> read_line(std::size_t max_bytes);
  SteadyTime deadline() const;

  Connection& connection_;
  Framing framing_;
  bool expects_continue_;
  bool finished_ = false;
  bool first_chunk_ = true;
  std::uint64_t left_ = 0;
  std::uint64_t received_ = 0;
  SteadyTime started_;
};

}  // namespace valvetriage::http
