#pragma once

#include <chrono>
#include <functional>
#include <memory>

#include "server/http/endpoint.h"
#include "server/http/exchange.h"
#include "server/http/limits.h"
#include "server/http/log.h"

namespace valvetriage::http {

/// HTTP/1.1 over one listening socket.
///
/// One thread watches all connections that are idle or still send their head, so that a slow head costs a file
/// descriptor and no worker; a whole head goes to a worker, which reads the body, calls the handler and answers. Heads
/// have kHeadDeadline, bodies and answers a least rate. A handler that throws becomes a 500 that says nothing.
class Front {
 public:
  using Handler = std::function<Response(Request&)>;
  using Log = std::function<void(const Answered&)>;

  /// workers  requests served at a time
  Front(Listener listener, int workers, Handler handler, Log log);
  ~Front();

  const Endpoint& endpoint() const;

  /// Serves until `stop`: then no new connection is taken, idle ones are closed, and `on_stop` is called while requests
  /// under way are answered. After `patience` their connections are ended: no upload and no reader that is slow is
  /// waited for, and nobody was told that theirs is done.
  void run(
      const std::function<void()>& on_stop = [] {}, std::chrono::milliseconds patience = kStopPatience);
  /// May be called from any thread and from a signal handler.
  void stop();
  bool stopping() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace valvetriage::http
