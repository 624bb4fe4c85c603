#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <semaphore>

#include "server/http/metrics.h"
#include "server/jobs/accept.h"
#include "server/store/blob_store.h"
#include "server/store/store.h"

namespace valvetriage::http {

/// Series and simulations computed inside the server at a time: each may hold one large recording in memory.
inline constexpr int kMaxComputations = 2;
/// References learned at a time: minutes of a processor, which the workers need.
inline constexpr int kMaxLearning = 1;

using Places = std::counting_semaphore<>;

/// Residuals of valves by the analysis they belong to, which never changes; see stored_patterns.cpp.
struct ResidualCache;
std::shared_ptr<ResidualCache> make_residual_cache();

/// What the handlers work on. One per server, shared by all its threads; everything in it is thread-safe.
struct Service {
  Store& store;
  BlobStore& blobs;
  AcceptLimits limits{};
  int workers = 1;               ///< of the analysis, for Retry-After
  bool tokens_required = false;  ///< false: who reaches a local address may do everything
  bool check_host = true;  ///< only names of this machine in Host, so that no web page reaches it by a name of its own
  std::function<void()> job_added = [] {};  ///< wakes the workers
  std::function<bool()> stopping = [] { return false; };
  Metrics metrics{};
  std::atomic<int> event_waiters{0};  ///< requests that wait for an event now
  int max_event_waiters = 1;          ///< a quarter of the requests at a time: see make_http_server
  Places computations{kMaxComputations};
  Places learning{kMaxLearning};
  std::shared_ptr<ResidualCache> residuals = make_residual_cache();
};

}  // namespace valvetriage::http
