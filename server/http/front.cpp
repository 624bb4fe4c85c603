#include "server/http/front.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/tcp.h>
#include <sodium/randombytes.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <unordered_map>
#include <unordered_set>

#include "server/http/connection.h"
#include "server/http/limits.h"
#include "server/http/log.h"
#include "server/http/problem.h"

namespace valvetriage::http {
namespace {

using std::chrono::steady_clock;

/// How often deadlines of waiting connections are looked at.
constexpr int kTickMs = 250;
/// How long no connection is taken after the machine had no descriptor or memory for one.
constexpr std::chrono::milliseconds kOutOfDescriptorsPause{100};

std::string random_id() {
  std::uint64_t bits = 0;
  randombytes_buf(&bits, sizeof bits);
  return fmt::format("{:016x}", bits);
}

/// Reason phrases of RFC 9110 for the statuses this service answers with.
std::string_view reason_of(int status) {
  static constexpr std::pair<int, std::string_view> kReasons[] = {{200, "OK"},
                                                                  {201, "Created"},
                                                                  {202, "Accepted"},
                                                                  {204, "No Content"},
                                                                  {304, "Not Modified"},
                                                                  {400, "Bad Request"},
                                                                  {401, "Unauthorized"},
                                                                  {403, "Forbidden"},
                                                                  {404, "Not Found"},
                                                                  {405, "Method Not Allowed"},
                                                                  {408, "Request Timeout"},
                                                                  {409, "Conflict"},
                                                                  {411, "Length Required"},
                                                                  {412, "Precondition Failed"},
                                                                  {413, "Content Too Large"},
                                                                  {414, "URI Too Long"},
                                                                  {415, "Unsupported Media Type"},
                                                                  {417, "Expectation Failed"},
                                                                  {422, "Unprocessable Content"},
                                                                  {429, "Too Many Requests"},
                                                                  {431, "Request Header Fields Too Large"},
                                                                  {500, "Internal Server Error"},
                                                                  {501, "Not Implemented"},
                                                                  {503, "Service Unavailable"},
                                                                  {505, "HTTP Version Not Supported"},
                                                                  {507, "Insufficient Storage"}};
  for (const auto& [known, reason] : kReasons) {
    if (known == status) return reason;
  }
  return "Unassigned";
}

bool has_body(int status) {
  return status != 204 && status != 304;
}

std::string head_of(const Response& response, const std::string& id, bool keep_alive) {
  std::string head = fmt::format("HTTP/1.1 {} {}\r\n", response.status, reason_of(response.status));
  if (has_body(response.status)) {
    const auto length = response.stream ? response.stream_length : response.body.size();
    head += fmt::format("Content-Length: {}\r\nContent-Type: {}\r\n", length, response.content_type);
  }
  head += fmt::format("X-Request-Id: {}\r\nX-Content-Type-Options: nosniff\r\nConnection: {}\r\n", id,
                      keep_alive ? "keep-alive" : "close");
  for (const auto& [name, value] : response.headers) {
    if (!has_control_character(value)) head += fmt::format("{}: {}\r\n", name, value);
  }
  return head + "\r\n";
}

/// A connection that waits for (the rest of) a head.
struct Waiting {
  Connection connection;
  SteadyTime deadline;
};

}  // namespace

struct Front::State {
  State(Listener l, Handler h, Log g)
      : listener(std::move(l)),
        handler(std::move(h)),
        log(std::move(g)),
        poller(epoll_create1(EPOLL_CLOEXEC)),
        wake(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
    watch(listener.descriptor());
    watch(wake);
  }
  ~State() {
    close(poller);
    close(wake);
  }

  void watch(int descriptor) {
    epoll_event event{};
    event.events = EPOLLIN;
    event.data.fd = descriptor;
    epoll_ctl(poller, EPOLL_CTL_ADD, descriptor, &event);
  }
  void forget(int descriptor) { epoll_ctl(poller, EPOLL_CTL_DEL, descriptor, nullptr); }
  void ring() const {
    const std::uint64_t one = 1;
    [[maybe_unused]] const auto n = write(wake, &one, sizeof one);
  }

  void accept_connections();
  void pause_listening();
  void resume_listening();
  std::size_t connections();
  void wait_for_head(Connection connection, std::chrono::seconds patience);
  void continue_head(int descriptor);
  void take_returned();
  void drop_overdue();
  bool is_done();
  void cut_off();
  void hand_over(Connection connection);
  void work();
  bool serve(Connection& connection);
  Response answer(Request& request) const;
  bool send(Connection& connection, const Request& request, const Response& response, bool keep_alive) const;

  Listener listener;
  Handler handler;
  Log log;
  int poller;
  int wake;
  std::atomic<bool> stopping{false};

  std::unordered_map<int, Waiting> waiting;  // the watching thread's own
  std::optional<SteadyTime> listens_again;   // likewise; set while the listener is not watched

  std::mutex mutex;
  std::condition_variable ready_changed;
  std::deque<Connection> ready;
  std::deque<Connection> returned;
  std::unordered_set<int> in_work;  // their descriptors
  bool no_more = false;
  std::vector<std::thread> workers;
};

void Front::State::accept_connections() {
  for (;;) {
    sockaddr_storage address{};
    socklen_t size = sizeof address;
    const int descriptor =
        accept4(listener.descriptor(), reinterpret_cast<sockaddr*>(&address), &size, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (descriptor < 0) {
      // Level-triggered: what cannot be taken now would ring at once again.
      if (errno == EMFILE || errno == ENFILE || errno == ENOBUFS || errno == ENOMEM) pause_listening();
      return;
    }
    std::array<char, INET6_ADDRSTRLEN> text{};
    if (address.ss_family == AF_INET) {
      inet_ntop(AF_INET, &reinterpret_cast<sockaddr_in*>(&address)->sin_addr, text.data(), text.size());
    } else if (address.ss_family == AF_INET6) {
      inet_ntop(AF_INET6, &reinterpret_cast<sockaddr_in6*>(&address)->sin6_addr, text.data(), text.size());
    }
    const int on = 1;  // answers go out at once: Nagle's algorithm costs a factor of 50 on small ones
    if (address.ss_family != AF_UNIX) setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    Connection connection(descriptor, text[0] ? std::string(text.data()) : "unix");
    if (connections() < kMaxConnections) wait_for_head(std::move(connection), kHeadDeadline);
  }
}

/// Those that wait, that are served, and that stand between the two.
std::size_t Front::State::connections() {
  const std::lock_guard lock(mutex);
  return waiting.size() + ready.size() + in_work.size() + returned.size();
}

void Front::State::pause_listening() {
  forget(listener.descriptor());
  listens_again = steady_clock::now() + kOutOfDescriptorsPause;
}

void Front::State::resume_listening() {
  if (!listens_again || steady_clock::now() < *listens_again) return;
  listens_again.reset();
  watch(listener.descriptor());
}

void Front::State::wait_for_head(Connection connection, std::chrono::seconds patience) {
  const int descriptor = connection.descriptor();
  watch(descriptor);
  waiting.insert_or_assign(descriptor, Waiting{std::move(connection), steady_clock::now() + patience});
  continue_head(descriptor);
}

void Front::State::continue_head(int descriptor) {
  const auto found = waiting.find(descriptor);
  if (found == waiting.end()) return;
  Waiting& one = found->second;
  const bool was_idle = one.connection.buffered() == 0;
  const bool alive = one.connection.fill();
  const bool whole = one.connection.head_size() != 0 || one.connection.buffered() > kMaxHeadBytes;
  if (!alive && !whole) {
    waiting.erase(found);
  } else if (whole) {
    forget(descriptor);
    Connection connection = std::move(one.connection);
    waiting.erase(found);
    hand_over(std::move(connection));
  } else if (was_idle && one.connection.buffered() != 0) {
    one.deadline = steady_clock::now() + kHeadDeadline;
  }
}

void Front::State::hand_over(Connection connection) {
  const std::lock_guard lock(mutex);
  ready.push_back(std::move(connection));
  ready_changed.notify_one();
}

void Front::State::take_returned() {
  std::uint64_t rung = 0;
  [[maybe_unused]] const auto n = read(wake, &rung, sizeof rung);
  std::deque<Connection> back;
  {
    const std::lock_guard lock(mutex);
    back.swap(returned);
  }
  if (stopping) return;
  for (Connection& connection : back) wait_for_head(std::move(connection), kIdleDeadline);
}

void Front::State::drop_overdue() {
  const auto now = steady_clock::now();
  std::erase_if(waiting, [&](const auto& entry) { return entry.second.deadline < now; });
}

bool Front::State::is_done() {
  const std::lock_guard lock(mutex);
  return in_work.empty() && ready.empty();
}

/// Whoever reads or writes such a connection sees its end.
void Front::State::cut_off() {
  const std::lock_guard lock(mutex);
  for (const int descriptor : in_work) shutdown(descriptor, SHUT_RDWR);
}

Response Front::State::answer(Request& request) const {
  try {
    return handler(request);
  } catch (const std::exception& error) {
    log_event("exception", fmt::format("request {}: {}", request.id, error.what()));
    return problem(
        Error{.code = "internal", .message = "an internal fault; the log has it under request " + request.id});
  }
}

bool Front::State::send(Connection& connection, const Request& request, const Response& response,
                        bool keep_alive) const {
  std::string out = head_of(response, request.id, keep_alive);
  if (request.head.method == "HEAD" || !has_body(response.status)) return connection.write(out);
  if (response.stream) {
    return connection.write(out) && response.stream([&](std::string_view bytes) { return connection.write(bytes); });
  }
  if (response.body.size() > kMaxHeadBytes) return connection.write(out) && connection.write(response.body);
  return connection.write(out + response.body);
}

bool Front::State::serve(Connection& connection) {
  const auto started = steady_clock::now();
  Request request;
  request.id = random_id();
  request.client = connection.client();
  const std::size_t head_bytes = connection.head_size();
  auto head = parse_request_head(connection.take(head_bytes ? head_bytes : kMaxHeadBytes + 1));
  const bool understood = head.has_value();
  if (understood) request.head = std::move(*head);
  BodySource body(connection, request.head);
  request.body = &body;
  const Response response = understood ? answer(request) : problem(head.error());
  if (response.status < 400) body.drain();
  const bool keep_alive = understood && request.head.keep_alive && body.finished() && !stopping;
  const bool sent = send(connection, request, response, keep_alive);
  log(Answered{.id = request.id,
               .client = request.client,
               .actor = request.actor,
               .method = request.head.method,
               .path = request.head.path_text,
               .status = response.status,
               .bytes_in = body.received_bytes(),
               .bytes_out = response.stream ? response.stream_length : response.body.size(),
               .seconds = std::chrono::duration<double>(steady_clock::now() - started).count()});
  if (sent && !(understood && body.finished())) connection.linger();
  return sent && keep_alive;
}

void Front::State::work() {
  std::unique_lock lock(mutex);
  for (;;) {
    ready_changed.wait(lock, [this] { return !ready.empty() || no_more; });
    if (ready.empty()) return;
    {
      Connection connection = std::move(ready.front());
      ready.pop_front();
      in_work.insert(connection.descriptor());
      lock.unlock();
      const bool keep = serve(connection);
      lock.lock();
      in_work.erase(connection.descriptor());
      if (keep) returned.push_back(std::move(connection));
    }
    ring();
  }
}

Front::Front(Listener listener, int workers, Handler handler, Log log)
    : state_(std::make_unique<State>(std::move(listener), std::move(handler), std::move(log))) {
  for (int i = 0; i < workers; ++i) state_->workers.emplace_back([this] { state_->work(); });
}

Front::~Front() {
  {
    const std::lock_guard lock(state_->mutex);
    state_->no_more = true;
  }
  state_->ready_changed.notify_all();
  for (std::thread& worker : state_->workers) worker.join();
}

const Endpoint& Front::endpoint() const {
  return state_->listener.endpoint();
}

void Front::stop() {
  state_->stopping = true;
  state_->ring();
}

bool Front::stopping() const {
  return state_->stopping;
}

void Front::run(const std::function<void()>& on_stop, std::chrono::milliseconds patience) {
  State& state = *state_;
  std::array<epoll_event, 64> events;
  while (!state.stopping) {
    const int n = epoll_wait(state.poller, events.data(), events.size(), kTickMs);
    for (int i = 0; i < n; ++i) {
      const int descriptor = events[static_cast<std::size_t>(i)].data.fd;
      if (descriptor == state.listener.descriptor()) {
        state.accept_connections();
      } else if (descriptor == state.wake) {
        state.take_returned();
      } else {
        state.continue_head(descriptor);
      }
    }
    state.drop_overdue();
    state.resume_listening();
  }
  const auto last_answer = steady_clock::now() + patience;
  state.forget(state.listener.descriptor());
  state.waiting.clear();
  on_stop();
  while (!state.is_done()) {
    if (steady_clock::now() > last_answer) state.cut_off();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

}  // namespace valvetriage::http
