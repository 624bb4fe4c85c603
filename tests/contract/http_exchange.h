#pragma once

#include <string>
#include <utility>
#include <vector>

namespace valvetriage {

/// An answer read from a socket, byte for byte.
struct RawAnswer {
  int status = 0;  ///< 0: the connection closed without one
  std::string head;
  std::string body;

  std::string header(const std::string& name) const;
};

/// Sends bytes to 127.0.0.1:port and reads until the other side closes. The bytes are whatever an attacker would send.
RawAnswer send_raw(int port, const std::string& bytes);

using Headers = std::vector<std::pair<std::string, std::string>>;

/// A well-formed request on its own connection.
RawAnswer request(int port, const std::string& method, const std::string& target, const std::string& body = "",
                  const Headers& headers = {});

}  // namespace valvetriage
