#pragma once

#include <atomic>

#include "server/store/clock.h"

namespace valvetriage::test {

/// A clock that stands until it is told to jump; wall time and steady time apart.
class ManualClock final : public Clock {
 public:
  TimestampMs utc_ms() const override { return utc_ms_; }
  std::int64_t steady_ms() const override { return steady_ms_; }

  void advance_ms(std::int64_t by) {
    utc_ms_ += by;
    steady_ms_ += by;
  }
  void jump_wall_ms(std::int64_t by) { utc_ms_ += by; }
  void reboot() { steady_ms_ = 1'000; }

 private:
  std::atomic<TimestampMs> utc_ms_ = 1'785'000'000'000;
  std::atomic<std::int64_t> steady_ms_ = 500'000'000;
};

}  // namespace valvetriage::test
