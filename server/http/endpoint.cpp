#include "server/http/endpoint.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstring>
#include <memory>

#include "server/http/limits.h"

namespace valvetriage::http {
namespace {

constexpr const char* kExpected = "HOST:PORT (for instance 127.0.0.1:8080 or [::1]:8080) or unix:PATH";

tl::unexpected<Error> cannot_listen(const Endpoint& endpoint, int error) {
  if (error == EADDRINUSE) {
    return fail("address_in_use",
                fmt::format("{} is in use by another process; stop it or choose another --listen", endpoint.url()));
  }
  return fail("cannot_listen", fmt::format("cannot listen on {}: {}", endpoint.url(), std::strerror(error)));
}

bool is_loopback(const sockaddr* address) {
  if (address->sa_family == AF_INET) {
    const auto* v4 = reinterpret_cast<const sockaddr_in*>(address);
    return (ntohl(v4->sin_addr.s_addr) >> 24) == 127;
  }
  return address->sa_family == AF_INET6 &&
         IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr);
}

int port_of(int descriptor) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  if (getsockname(descriptor, reinterpret_cast<sockaddr*>(&address), &size) != 0) return 0;
  return ntohs(address.ss_family == AF_INET6 ? reinterpret_cast<sockaddr_in6*>(&address)->sin6_port
                                             : reinterpret_cast<sockaddr_in*>(&address)->sin_port);
}

sockaddr_un unix_address(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size() + 1);
  return address;
}

/// A socket file whose server has died refuses connections and may go; anything else stays.
bool remove_stale_socket(const std::string& path, const sockaddr_un& address) {
  struct stat status {};
  if (lstat(path.c_str(), &status) != 0) return true;
  if (!S_ISSOCK(status.st_mode)) return false;
  const int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const bool refused =
      connect(probe, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 && errno == ECONNREFUSED;
  close(probe);
  return refused && unlink(path.c_str()) == 0;
}

Result<int> bind_and_listen(int family, const sockaddr* address, socklen_t size, const Endpoint& endpoint) {
  const int descriptor = socket(family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (descriptor < 0) return cannot_listen(endpoint, errno);
  const int on = 1;  // REUSEADDR alone: a restart may take over a port in TIME_WAIT, two processes may not share one
  setsockopt(descriptor, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (bind(descriptor, address, size) != 0 || ::listen(descriptor, kListenBacklog) != 0) {
    const int error = errno;
    close(descriptor);
    return cannot_listen(endpoint, error);
  }
  return descriptor;
}

Result<int> listen_unix(const Endpoint& endpoint) {
  if (endpoint.socket_path.size() >= sizeof(sockaddr_un::sun_path)) {
    return fail("cannot_listen",
                fmt::format("the socket path is longer than {} bytes", sizeof(sockaddr_un::sun_path) - 1));
  }
  const sockaddr_un address = unix_address(endpoint.socket_path);
  if (!remove_stale_socket(endpoint.socket_path, address)) return cannot_listen(endpoint, EADDRINUSE);
  const mode_t before = umask(0117);  // owner and group only
  auto descriptor = bind_and_listen(AF_UNIX, reinterpret_cast<const sockaddr*>(&address), sizeof address, endpoint);
  umask(before);
  return descriptor;
}

}  // namespace

std::string Endpoint::url() const {
  if (is_unix()) return "unix:" + socket_path;
  const bool v6 = host.find(':') != std::string::npos;
  return v6 ? fmt::format("http://[{}]:{}", host, port) : fmt::format("http://{}:{}", host, port);
}

Result<Endpoint> parse_endpoint(const std::string& text) {
  Endpoint endpoint;
  const auto bad = [&] { return fail("bad_parameter", fmt::format("'{}' is not {}", text, kExpected)); };
  if (text.starts_with("unix:")) {
    endpoint.socket_path = text.substr(5);
    if (endpoint.socket_path.empty()) return bad();
    return endpoint;
  }
  const auto colon = text.rfind(':');
  if (colon == std::string::npos || colon == 0) return bad();
  endpoint.host = text.substr(0, colon);
  if (endpoint.host.starts_with('[') && endpoint.host.ends_with(']')) {
    endpoint.host = endpoint.host.substr(1, endpoint.host.size() - 2);
  } else if (endpoint.host.find(':') != std::string::npos) {
    return bad();
  }
  const auto [end, error] = std::from_chars(text.data() + colon + 1, text.data() + text.size(), endpoint.port);
  if (error != std::errc() || end != text.data() + text.size() || endpoint.port < 0 || endpoint.port > 65535)
    return bad();
  return endpoint;
}

Result<Listener> Listener::open(const Endpoint& endpoint) {
  if (endpoint.is_unix()) {
    const auto descriptor = listen_unix(endpoint);
    if (!descriptor) return tl::unexpected(descriptor.error());
    return Listener(*descriptor, endpoint, true);
  }
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_PASSIVE;
  addrinfo* found = nullptr;
  if (const int error = getaddrinfo(endpoint.host.c_str(), std::to_string(endpoint.port).c_str(), &hints, &found)) {
    return fail("cannot_listen", fmt::format("cannot listen on {}: {}", endpoint.url(), gai_strerror(error)));
  }
  const std::unique_ptr<addrinfo, void (*)(addrinfo*)> addresses(found, freeaddrinfo);
  const auto descriptor = bind_and_listen(found->ai_family, found->ai_addr, found->ai_addrlen, endpoint);
  if (!descriptor) return tl::unexpected(descriptor.error());
  Endpoint bound = endpoint;
  bound.port = port_of(*descriptor);
  return Listener(*descriptor, bound, is_loopback(found->ai_addr));
}

Listener::Listener(int descriptor, Endpoint endpoint, bool local)
    : descriptor_(descriptor), endpoint_(std::move(endpoint)), local_(local) {}

Listener::Listener(Listener&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)), endpoint_(std::move(other.endpoint_)), local_(other.local_) {}

Listener::~Listener() {
  if (descriptor_ < 0) return;
  close(descriptor_);
  if (endpoint_.is_unix()) unlink(endpoint_.socket_path.c_str());
}

}  // namespace valvetriage::http
