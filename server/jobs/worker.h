#pragma once

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "server/jobs/child_process.h"
#include "server/jobs/child_protocol.h"
#include "server/store/blob_store.h"
#include "server/store/store.h"

namespace valvetriage {

/// child_command  what runs one job; empty: this binary with the verb `analysis-child`
/// lease_ms       how long a job stays this worker's without a sign of life; a sign is given every third of it
/// poll_ms        how often an idle worker looks for work that nobody told it of
struct WorkerOptions {
  int workers = 2;
  std::vector<std::string> child_command;
  ChildLimits child;
  std::int64_t lease_ms = 30'000;
  std::int64_t poll_ms = 500;
  std::optional<std::string> rule_base_json{};  ///< serves valve types that have no rule base of their own
  std::function<void(std::string_view message)> log = [](std::string_view) {};
};

/// Threads that take jobs from the store and run each in a child process. Starts at once; the destructor drains.
///
/// A job that is cancelled, or whose lease is lost, loses its child within about a second. Thread-safe.
class WorkerPool {
 public:
  WorkerPool(Store& store, BlobStore& blobs, WorkerOptions options);
  ~WorkerPool();
  WorkerPool(const WorkerPool&) = delete;
  WorkerPool& operator=(const WorkerPool&) = delete;

  /// Work has come: an idle worker looks at once.
  void wake();

  /// Stops the children, hands their jobs back with the attempt not counted, ends the threads. May be called twice.
  void drain();

  /// How many workers run a child now.
  int busy() const { return busy_; }

 private:
  void loop(int number);
  bool run_next(const std::string& name);
  void run(const JobRow& job);
  std::uint64_t wakes();
  void wait_for_work(std::uint64_t seen);
  bool draining();

  Store& store_;
  BlobStore& blobs_;
  WorkerOptions options_;
  std::string pool_name_;
  std::atomic<int> busy_ = 0;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool draining_ = false;
  std::uint64_t wakes_ = 0;
  std::vector<std::thread> threads_;
};

}  // namespace valvetriage
