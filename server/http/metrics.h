#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <string>

#include "server/store/store.h"

namespace valvetriage::http {

/// Counters of the HTTP front since the start. No label is ever a text of the user's. Thread-safe.
class Metrics {
 public:
  void count_request(int status, double seconds, std::uint64_t bytes_in, std::uint64_t bytes_out);
  void count_accepted_recordings(std::size_t recordings) { accepted_ += recordings; }

  /// Prometheus text format 0.0.4: the counters, and the queue as the store has it.
  std::string text(const QueueStats& queue, TimestampMs now) const;

 private:
  static constexpr std::array<double, 9> kBounds_s{0.001, 0.005, 0.01, 0.05, 0.1, 0.5, 1, 5, 30};

  std::array<std::atomic<std::uint64_t>, 5> by_class_{};
  std::array<std::atomic<std::uint64_t>, kBounds_s.size() + 1> by_duration_{};
  std::atomic<double> seconds_{0};
  std::atomic<std::uint64_t> bytes_in_{0}, bytes_out_{0}, accepted_{0};
};

}  // namespace valvetriage::http
