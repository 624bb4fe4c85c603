#include <fmt/format.h>

#include <charconv>
#include <chrono>
#include <thread>

#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/views.h"

namespace valvetriage::http {
namespace {

using std::chrono::steady_clock;

/// A place among those that wait, held as long as it lives.
class WaitingPlace {
 public:
  explicit WaitingPlace(Service& service)
      : service_(service), taken_(++service.event_waiters <= service.max_event_waiters) {}
  WaitingPlace(const WaitingPlace&) = delete;
  WaitingPlace& operator=(const WaitingPlace&) = delete;
  ~WaitingPlace() { --service_.event_waiters; }
  bool taken() const { return taken_; }

 private:
  Service& service_;
  bool taken_;
};

Result<std::int64_t> cursor_of(std::string_view text) {
  std::int64_t cursor = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), cursor);
  if (error == std::errc() && end == text.data() + text.size() && cursor >= 0) return cursor;
  return fail("invalid_cursor", "after is not a cursor that an earlier answer gave as 'next'");
}

Result<std::chrono::duration<double>> longest_wait(const Request& request) {
  const auto text = request.head.parameter("wait_s");
  double seconds = 0;
  if (!text) return std::chrono::duration<double>(seconds);
  const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), seconds);
  if (error == std::errc() && end == text->data() + text->size() && seconds >= 0 && seconds <= kMaxEventWaitSeconds) {
    return std::chrono::duration<double>(seconds);
  }
  Error bad{.code = "bad_parameter", .message = fmt::format("wait_s is a number from 0 to {}", kMaxEventWaitSeconds)};
  bad.field = "wait_s";
  bad.found = *text;
  return tl::unexpected(bad);
}

Result<Response> event_response(const Request& request, const std::vector<EventRow>& rows, std::int64_t after) {
  std::vector<Json> items;
  for (const EventRow& row : rows) {
    auto detail = parse_json(row.detail_json);
    items.push_back(Json{{"cursor", std::to_string(row.cursor)},
                         {"at", format_rfc3339(row.at)},
                         {"kind", row.kind},
                         {"subject", row.subject},
                         {"actor", row.actor},
                         {"detail", detail ? std::move(*detail) : Json(nullptr)}});
  }
  const std::int64_t next = rows.empty() ? after : rows.back().cursor;
  auto response = list_response(request, std::move(items), std::to_string(next));
  if (response) response->set_header("Cache-Control", "no-store");
  return response;
}

}  // namespace

Result<Response> get_events(Service& service, Request& request) {
  const auto page = page_request(request);
  if (!page) return tl::unexpected(page.error());
  const auto wait = longest_wait(request);
  if (!wait) return tl::unexpected(wait.error());
  const auto asked = request.head.parameter("after");
  if (!asked) {
    const auto newest = service.store.newest_event();
    if (!newest) return tl::unexpected(newest.error());
    return event_response(request, {}, *newest);
  }
  const auto after = cursor_of(*asked);
  if (!after) return tl::unexpected(after.error());
  const auto until = steady_clock::now() + *wait;
  std::optional<WaitingPlace> place;
  for (;;) {
    const auto rows = service.store.events_after(*after, page->limit);
    if (!rows) return tl::unexpected(rows.error());
    if (!rows->empty() || steady_clock::now() >= until || service.stopping())
      return event_response(request, *rows, *after);
    if (!place) place.emplace(service);
    if (!place->taken()) return fail("busy", "too many requests wait for events already; ask again without wait_s");
    std::this_thread::sleep_for(kEventInterval);
  }
}

}  // namespace valvetriage::http
