#include "tests/contract/http_exchange.h"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>

namespace valvetriage {
namespace {

int connect_to(int port) {
  const int descriptor = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const timeval patience{30, 0};  // far above every deadline of the server: a hang fails instead of hanging the tests
  setsockopt(descriptor, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  if (connect(descriptor, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0) return descriptor;
  close(descriptor);
  return -1;
}

RawAnswer parse(const std::string& text) {
  RawAnswer answer;
  std::size_t start = 0;
  while (text.compare(start, 12, "HTTP/1.1 100") == 0) start = text.find("\r\n\r\n", start) + 4;
  const auto end = text.find("\r\n\r\n", start);
  if (end == std::string::npos) return answer;
  answer.head = text.substr(start, end + 2 - start);
  answer.body = text.substr(end + 4);
  if (answer.head.starts_with("HTTP/1.1 ")) answer.status = std::atoi(answer.head.c_str() + 9);
  return answer;
}

}  // namespace

std::string RawAnswer::header(const std::string& name) const {
  const std::string key = "\r\n" + name + ": ";
  const auto at = head.find(key);
  if (at == std::string::npos) return "";
  const auto begin = at + key.size();
  return head.substr(begin, head.find("\r\n", begin) - begin);
}

RawAnswer send_raw(int port, const std::string& bytes) {
  const int descriptor = connect_to(port);
  if (descriptor < 0) return {};
  for (std::size_t sent = 0; sent < bytes.size();) {
    const ssize_t n = send(descriptor, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
    if (n <= 0) break;
    sent += static_cast<std::size_t>(n);
  }
  std::string text;
  std::array<char, 65536> piece;
  for (ssize_t n = 0; (n = recv(descriptor, piece.data(), piece.size(), 0)) > 0;) {
    text.append(piece.data(), static_cast<std::size_t>(n));
  }
  close(descriptor);
  return parse(text);
}

RawAnswer request(int port, const std::string& method, const std::string& target, const std::string& body,
                  const Headers& headers) {
  std::string bytes = method + " " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n";
  for (const auto& [name, value] : headers) bytes += name + ": " + value + "\r\n";
  if (!body.empty() || method == "POST") bytes += "Content-Length: " + std::to_string(body.size()) + "\r\n";
  return send_raw(port, bytes + "\r\n" + body);
}

}  // namespace valvetriage
