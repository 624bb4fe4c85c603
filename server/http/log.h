#pragma once

#include <cstdint>
#include <string>

#include "core/result.h"

namespace valvetriage::http {

/// What one answered request was, for the log and the counters.
struct Answered {
  std::string id, client, actor, method, path;
  int status = 0;
  std::uint64_t bytes_in = 0, bytes_out = 0;
  double seconds = 0;
};

/// One event is one line of JSON on standard error, pure ASCII, whatever a client put into its request. Queries and
/// headers, where secrets and serial numbers stand, are never in it. Thread-safe.
void log_answered(const Answered& answered);
/// A fault of ours, with the message that its caller is not shown.
void log_fault(const std::string& request_id, const Error& error);
/// Anything else the operator should see: "listening", "stopping".
void log_event(const std::string& event, const std::string& detail);

}  // namespace valvetriage::http
