#include "server/http/log.h"

#include <cstdio>

#include "server/store/clock.h"
#include "server/wire/json.h"

namespace valvetriage::http {
namespace {

void write_line(const char* event, const Json& members) {
  Json line{{"at", format_rfc3339(system_clock().utc_ms())}, {"event", event}};
  line.update(members);
  const std::string text = line.dump(-1, ' ', true, Json::error_handler_t::replace) + '\n';
  std::fwrite(text.data(), 1, text.size(), stderr);  // one call, so that lines of several threads never mix
}

}  // namespace

void log_answered(const Answered& answered) {
  write_line("request", Json{{"request", answered.id},
                             {"client", answered.client},
                             {"actor", answered.actor},
                             {"method", answered.method},
                             {"path", answered.path},
                             {"status", answered.status},
                             {"bytes_in", answered.bytes_in},
                             {"bytes_out", answered.bytes_out},
                             {"seconds", answered.seconds}});
}

void log_fault(const std::string& request_id, const Error& error) {
  write_line("fault", Json{{"request", request_id}, {"code", error.code}, {"message", error.message}});
}

void log_event(const std::string& event, const std::string& detail) {
  write_line(event.c_str(), Json{{"detail", detail}});
}

}  // namespace valvetriage::http
