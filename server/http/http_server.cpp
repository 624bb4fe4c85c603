#include "server/http/http_server.h"

#include <algorithm>

#include "server/http/routes.h"

namespace valvetriage::http {

std::unique_ptr<Front> make_http_server(Service& service, Listener listener, int connections, bool log_requests) {
  const auto answer = [&service](Request& request) { return dispatch(service, request); };
  const auto log = [&service, log_requests](const Answered& answered) {
    service.metrics.count_request(answered.status, answered.seconds, answered.bytes_in, answered.bytes_out);
    if (log_requests) log_answered(answered);
  };
  // Waiting requests hold a thread each: most of the threads stay free for those who do not wait.
  service.max_event_waiters = std::max(1, connections / 4);
  auto front = std::make_unique<Front>(std::move(listener), connections, answer, log);
  service.stopping = [watched = front.get()] { return watched->stopping(); };
  return front;
}

}  // namespace valvetriage::http
