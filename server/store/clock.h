#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace valvetriage {

/// Milliseconds since 1970-01-01T00:00:00Z. Integers inside; RFC 3339 text outside.
using TimestampMs = std::int64_t;

/// The two clocks the service reads, behind an interface so that tests can jump them apart.
///
/// utc_ms      what people call the time; shown, stored, compared with nothing that must not fail when it is set back
/// steady_ms   never goes back and runs while the machine sleeps (CLOCK_BOOTTIME); leases, backoff and timeouts live on
/// it
class Clock {
 public:
  virtual ~Clock() = default;
  virtual TimestampMs utc_ms() const = 0;
  virtual std::int64_t steady_ms() const = 0;
};

/// The machine's clocks. Thread-safe; lives as long as the process.
const Clock& system_clock();

/// "2026-08-03T09:12:44.000Z": RFC 3339, UTC, always with milliseconds.
std::string format_rfc3339(TimestampMs time);

/// The instant an RFC 3339 text names ("2026-08-03T09:12:44Z", fractions and "+02:00" accepted), or nothing.
std::optional<TimestampMs> parse_rfc3339(std::string_view text);

}  // namespace valvetriage
