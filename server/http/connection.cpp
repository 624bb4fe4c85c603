#include "server/http/connection.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>

#include "server/http/limits.h"

namespace valvetriage::http {
namespace {

using std::chrono::steady_clock;

constexpr std::size_t kReceiveBytes = 16 * 1024;

bool wait_for(int descriptor, short events, SteadyTime deadline) {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - steady_clock::now()).count();
    if (left <= 0) return false;
    pollfd polled{descriptor, events, 0};
    const int ready = poll(&polled, 1, static_cast<int>(std::min<long long>(left, 60'000)));
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
  }
}

bool would_block(int error) {
  return error == EAGAIN || error == EWOULDBLOCK || error == EINTR;
}

}  // namespace

Connection::Connection(int descriptor, std::string client) : descriptor_(descriptor), client_(std::move(client)) {}

Connection::Connection(Connection&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)),
      client_(std::move(other.client_)),
      buffer_(std::move(other.buffer_)),
      taken_(std::exchange(other.taken_, 0)) {}

Connection& Connection::operator=(Connection&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(client_, other.client_);
  std::swap(buffer_, other.buffer_);
  std::swap(taken_, other.taken_);
  return *this;
}

Connection::~Connection() {
  if (descriptor_ >= 0) close(descriptor_);
}

bool Connection::fill() {
  while (buffered() <= kMaxHeadBytes) {
    const ssize_t n = receive();
    if (n == 0) return false;
    if (n < 0) return would_block(errno);
  }
  return true;
}

ssize_t Connection::receive() {
  std::array<char, kReceiveBytes> piece;
  const ssize_t n = recv(descriptor_, piece.data(), piece.size(), 0);
  if (n > 0) buffer_.append(piece.data(), static_cast<std::size_t>(n));
  return n;
}

std::size_t Connection::head_size() const {
  // A head with bare line feeds is whole as well: it is refused at once rather than waited for.
  const auto strict = buffer_.find("\r\n\r\n", taken_);
  const auto bare = buffer_.find("\n\n", taken_);
  if (strict == std::string::npos && bare == std::string::npos) return 0;
  return (bare < strict ? bare + 2 : strict + 4) - taken_;
}

std::string Connection::take(std::size_t size) {
  std::string taken = buffer_.substr(taken_, size);
  taken_ += taken.size();
  // What was taken is let go of: a client that always sends one request ahead never leaves the buffer empty.
  if (buffered() == 0 || taken_ >= kReceiveBytes) {
    buffer_.erase(0, taken_);
    taken_ = 0;
  }
  return taken;
}

Result<std::size_t> Connection::read(std::span<char> into, SteadyTime deadline) {
  while (buffered() == 0) {
    // Large reads go straight to their place; small ones (chunk sizes) through the buffer, not a system call per byte.
    const bool direct = into.size() >= kReceiveBytes;
    const ssize_t n = direct ? recv(descriptor_, into.data(), into.size(), 0) : receive();
    if (n == 0 || (n > 0 && direct)) return static_cast<std::size_t>(n);
    if (n > 0) break;
    if (!would_block(errno)) return fail("incomplete_body", "the connection broke while the body was read");
    if (!wait_for(descriptor_, POLLIN, deadline)) return fail("request_timeout", "the body came too slowly");
  }
  const std::string piece = take(into.size());
  std::memcpy(into.data(), piece.data(), piece.size());
  return piece.size();
}

bool Connection::write(std::string_view bytes) {
  const auto started = steady_clock::now();
  std::uint64_t sent = 0;
  while (!bytes.empty()) {
    const ssize_t n = send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (n > 0) {
      bytes.remove_prefix(static_cast<std::size_t>(n));
      sent += static_cast<std::uint64_t>(n);
      continue;
    }
    const auto deadline = started + kAnswerGrace + std::chrono::seconds(sent / kMinBodyBytesPerSecond);
    if (!would_block(errno) || !wait_for(descriptor_, POLLOUT, deadline)) return false;
  }
  return true;
}

void Connection::linger() {
  shutdown(descriptor_, SHUT_WR);
  const auto deadline = steady_clock::now() + kLingerDeadline;
  std::array<char, kReceiveBytes> discarded;
  for (std::size_t total = 0; total < kLingerBytes;) {
    const auto n = read(discarded, deadline);
    if (!n || *n == 0) return;
    total += *n;
  }
}

BodySource::BodySource(Connection& connection, const RequestHead& head)
    : connection_(connection),
      framing_(head.framing),
      expects_continue_(head.expects_continue),
      finished_(head.framing == Framing::kNone || (head.framing == Framing::kLength && head.content_length == 0)),
      left_(head.framing == Framing::kLength ? head.content_length : 0),
      started_(steady_clock::now()) {}

SteadyTime BodySource::deadline() const {
  return started_ + kBodyGrace + std::chrono::seconds(received_ / kMinBodyBytesPerSecond);
}

Result<std::size_t> BodySource::read(std::span<char> buffer) {
  if (finished_ || buffer.empty()) return 0;
  if (expects_continue_) {
    expects_continue_ = false;  // only now: whoever refuses a request before reading its body never invites it
    if (!connection_.write("HTTP/1.1 100 Continue\r\n\r\n")) return fail("incomplete_body", "the client has gone");
  }
  if (framing_ == Framing::kChunked && left_ == 0) {
    if (auto chunk = next_chunk(); !chunk) return tl::unexpected(chunk.error());
    if (finished_) return 0;
  }
  const auto wanted = static_cast<std::size_t>(std::min<std::uint64_t>(left_, buffer.size()));
  const auto n = connection_.read(buffer.first(wanted), deadline());
  if (!n) return n;
  if (*n == 0) return fail("incomplete_body", "the connection closed before the body was whole");
  received_ += *n;
  left_ -= *n;
  if (framing_ == Framing::kLength && left_ == 0) finished_ = true;
  return n;
}

void BodySource::drain() {
  std::array<char, kReceiveBytes> rest;
  const std::uint64_t before = received_;
  while (!finished_ && received_ - before <= rest.size()) {
    if (!read(rest)) return;
  }
}

Result<std::string> BodySource::read_line(std::size_t max_bytes) {
  std::string line;
  while (!line.ends_with("\r\n")) {
    if (line.size() >= max_bytes) return fail("malformed_request", "a chunk header or trailer is too long");
    char byte = 0;
    const auto n = connection_.read({&byte, 1}, deadline());
    if (!n) return tl::unexpected(n.error());
    if (*n == 0) return fail("incomplete_body", "the connection closed before the body was whole");
    line.push_back(byte);
  }
  line.resize(line.size() - 2);
  return line;
}

Result<void> BodySource::next_chunk() {
  if (!first_chunk_) {
    const auto end = read_line(2);
    if (!end) return tl::unexpected(end.error());
    if (!end->empty()) return fail("malformed_request", "a chunk is longer than it says");
  }
  first_chunk_ = false;
  const auto line = read_line(kMaxChunkLineBytes);
  if (!line) return tl::unexpected(line.error());
  const std::string_view digits = std::string_view(*line).substr(0, line->find(';'));
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), left_, 16);
  if (has_control_character(*line, true)) return fail("malformed_request", "a chunk header holds a control character");
  if (digits.empty() || error != std::errc() || end != digits.data() + digits.size()) {
    return fail("malformed_request", "a chunk size is not a hexadecimal number");
  }
  if (left_ != 0) return {};
  for (std::size_t total = 0; total < kMaxTrailerBytes;) {
    const auto trailer = read_line(kMaxTrailerBytes);
    if (!trailer) return tl::unexpected(trailer.error());
    if (trailer->empty()) {
      finished_ = true;
      return {};
    }
    total += trailer->size();
  }
  return fail("malformed_request", "the trailers are too long");
}

}  // namespace valvetriage::http
