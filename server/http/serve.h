#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "server/http/endpoint.h"

namespace valvetriage::http {

/// How a server is run.
struct ServeOptions {
  std::string listen = "127.0.0.1:8080";
  std::string database_file;
  std::string data_dir;
  int workers = 2;             ///< analyses at a time; 0 accepts and stores only
  int connections = 64;        ///< requests at a time
  bool require_token = false;  ///< also on a local address
  bool behind_proxy = false;   ///< a proxy passes on what others send: being local proves nothing any more
  bool log_requests = true;
  std::optional<std::string> rule_base_json{};  ///< serves valve types that have no rule base of their own
  std::vector<std::string> child_command;       ///< what runs one job; empty: this binary
};

/// Opens database and data folder, listens, serves until SIGTERM or SIGINT, then drains: no new connection, requests
/// under way are answered, running jobs are handed back.
///
/// listening  called once, when requests are answered
/// Errors     what keeps it from starting, each with what to do: `unsafe_listen` for an address that others can reach
///            without tokens or without --behind-proxy, `address_in_use`, `store_locked`, ...
Result<void> serve(const ServeOptions& options, const std::function<void(const Endpoint&)>& listening);

/// Makes a folder and those above it; a new one is closed to others than its owner and group. Errors
/// `cannot_make_folder`.
Result<void> make_folder(const std::string& path);

}  // namespace valvetriage::http
