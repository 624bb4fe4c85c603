#include "server/http/metrics.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

namespace valvetriage::http {
namespace {

void describe(std::string& out, const char* name, const char* type, const char* help) {
  fmt::format_to(std::back_inserter(out), "# HELP valvetriage_{0} {2}\n# TYPE valvetriage_{0} {1}\n", name, type, help);
}

void value(std::string& out, const std::string& name, double number) {
  fmt::format_to(std::back_inserter(out), "valvetriage_{} {}\n", name, number);
}

}  // namespace

void Metrics::count_request(int status, double seconds, std::uint64_t bytes_in, std::uint64_t bytes_out) {
  ++by_class_[static_cast<std::size_t>(std::clamp(status / 100, 1, 5) - 1)];
  const auto bound = std::lower_bound(kBounds_s.begin(), kBounds_s.end(), seconds);
  ++by_duration_[static_cast<std::size_t>(bound - kBounds_s.begin())];
  seconds_ += seconds;
  bytes_in_ += bytes_in;
  bytes_out_ += bytes_out;
}

std::string Metrics::text(const QueueStats& queue, TimestampMs now) const {
  std::string out;
  describe(out, "http_requests_total", "counter", "Answered requests by class of status.");
  for (std::size_t i = 0; i < by_class_.size(); ++i) {
    value(out, fmt::format("http_requests_total{{class=\"{}xx\"}}", i + 1), static_cast<double>(by_class_[i]));
  }
  describe(out, "http_request_seconds", "histogram", "Time from the whole head to the last byte of the answer.");
  double total = 0;
  for (std::size_t i = 0; i < by_duration_.size(); ++i) {
    total += static_cast<double>(by_duration_[i]);
    const std::string bound = i < kBounds_s.size() ? fmt::format("{}", kBounds_s[i]) : "+Inf";
    value(out, fmt::format("http_request_seconds_bucket{{le=\"{}\"}}", bound), total);
  }
  value(out, "http_request_seconds_sum", seconds_);
  value(out, "http_request_seconds_count", total);
  describe(out, "http_received_bytes_total", "counter", "Bytes of bodies received, as sent.");
  value(out, "http_received_bytes_total", static_cast<double>(bytes_in_));
  describe(out, "http_sent_bytes_total", "counter", "Bytes of bodies sent.");
  value(out, "http_sent_bytes_total", static_cast<double>(bytes_out_));
  describe(out, "recordings_accepted_total", "counter", "Recordings accepted since the start.");
  value(out, "recordings_accepted_total", static_cast<double>(accepted_));
  describe(out, "jobs", "gauge", "Jobs by state.");
  for (const JobState state : kJobStates) {
    const auto found = queue.jobs.find(state);
    value(out, fmt::format("jobs{{state=\"{}\"}}", to_text(state)),
          found == queue.jobs.end() ? 0 : static_cast<double>(found->second));
  }
  describe(out, "oldest_queued_job_seconds", "gauge", "Age of the oldest waiting job.");
  value(out, "oldest_queued_job_seconds",
        queue.oldest_queued_at ? static_cast<double>(now - *queue.oldest_queued_at) / 1000 : 0);
  return out;
}

}  // namespace valvetriage::http
