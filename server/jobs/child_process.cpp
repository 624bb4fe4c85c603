#include "server/jobs/child_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <utility>

namespace valvetriage {
namespace {

constexpr int kTickMs = 100;

std::int64_t steady_now_ms() {
  timespec now{};
  ::clock_gettime(CLOCK_BOOTTIME, &now);
  return std::int64_t{now.tv_sec} * 1000 + now.tv_nsec / 1'000'000;
}

class FileDescriptor {
 public:
  explicit FileDescriptor(int fd = -1) : fd_(fd) {}
  FileDescriptor(FileDescriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(fd_, other.fd_);
    return *this;
  }
  ~FileDescriptor() { close(); }
  void close() {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  }
  int get() const { return fd_; }
  bool is_open() const { return fd_ >= 0; }

 private:
  int fd_;
};

struct Pipe {
  FileDescriptor read_end;
  FileDescriptor write_end;
};

/// Both ends close-on-exec: a child that another thread starts meanwhile inherits none of them.
Result<Pipe> make_pipe() {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) {
    return fail("cannot_start_child", fmt::format("cannot make a pipe: {}", std::strerror(errno)));
  }
  return Pipe{FileDescriptor(ends[0]), FileDescriptor(ends[1])};
}

void set_nonblocking(const FileDescriptor& end) {
  ::fcntl(end.get(), F_SETFL, O_NONBLOCK);
}

rlimit both(rlim_t bound) {
  return {bound, bound};
}

struct Pipes {
  Pipe input;
  Pipe output;
  Pipe messages;
};

/// In the child, between fork and exec: system calls only.
[[noreturn]] void become_child(const Pipes& pipes, const ChildLimits& limits, pid_t parent, char* const* arguments) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(127);  // it died before the line above
  ::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  ::dup2(pipes.input.read_end.get(), STDIN_FILENO);
  ::dup2(pipes.output.write_end.get(), STDOUT_FILENO);
  ::dup2(pipes.messages.write_end.get(), STDERR_FILENO);
  ::close_range(3, ~0U, 0);
  sigset_t none;
  ::sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  ::signal(SIGPIPE, SIG_DFL);
  const std::array<std::pair<__rlimit_resource, rlimit>, 4> bounds = {
      {{RLIMIT_AS, both(static_cast<rlim_t>(limits.memory_bytes))},
       // The soft bound ends it by SIGXCPU, which tells; the hard one comes later and only for what ignores that.
       {RLIMIT_CPU, {static_cast<rlim_t>(limits.cpu_s), static_cast<rlim_t>(limits.cpu_s + 5)}},
       {RLIMIT_FSIZE, both(0)},
       {RLIMIT_CORE, both(0)}}};
  for (const auto& [resource, bound] : bounds) {
    if (::setrlimit(resource, &bound) != 0) ::_exit(127);
  }
  ::execv(arguments[0], arguments);
  ::_exit(127);
}

/// A started child with our ends of its pipes.
struct Running {
  pid_t pid = -1;
  FileDescriptor input;
  FileDescriptor output;
  FileDescriptor messages;
};

Result<Running> start(const std::vector<std::string>& command, const ChildLimits& limits) {
  auto input = make_pipe();
  auto output = make_pipe();
  auto messages = make_pipe();
  if (!input || !output || !messages) return fail("cannot_start_child", "cannot make the child's pipes");
  Pipes pipes{std::move(*input), std::move(*output), std::move(*messages)};

  std::vector<char*> arguments;
  for (const std::string& argument : command) arguments.push_back(const_cast<char*>(argument.c_str()));
  arguments.push_back(nullptr);

  const pid_t parent = ::getpid();
  const pid_t pid = ::fork();
  if (pid < 0) return fail("cannot_start_child", fmt::format("cannot start a process: {}", std::strerror(errno)));
  if (pid == 0) become_child(pipes, limits, parent, arguments.data());

  Running running{pid, std::move(pipes.input.write_end), std::move(pipes.output.read_end),
                  std::move(pipes.messages.read_end)};
  for (const FileDescriptor* end : {&running.input, &running.output, &running.messages}) set_nonblocking(*end);
  return running;
}

/// Cuts what arrives into lines.
class LineReader {
 public:
  LineReader(std::size_t bound, const std::function<void(std::string_view)>& on_line)
      : bound_(bound), on_line_(on_line) {}

  /// False when there was more output than allowed.
  bool take(std::string_view bytes) {
    total_ += bytes.size();
    if (total_ > bound_) return false;
    // What was there before has no end of a line in it.
    std::size_t from = 0, unsearched = pending_.size();
    pending_ += bytes;
    for (std::size_t end; (end = pending_.find('\n', unsearched)) != std::string::npos;) {
      on_line_(std::string_view(pending_).substr(from, end - from));
      from = unsearched = end + 1;
    }
    pending_.erase(0, from);
    return true;
  }

 private:
  std::size_t bound_;
  const std::function<void(std::string_view)>& on_line_;
  std::size_t total_ = 0;
  std::string pending_;
};

/// Serves the three pipes of one child until it closes them, is stopped, or its time is up.
class Conversation {
 public:
  Conversation(Running& child, std::string_view input, const ChildLimits& limits, const ChildWatch& watch)
      : child_(child), input_(input), limits_(limits), watch_(watch), lines_(limits.answer_bytes, watch.on_line) {}

  /// Nothing: the child ended its side by itself.
  std::optional<ChildEnd> hold() {
    const std::int64_t deadline = steady_now_ms() + limits_.wall_ms;
    std::int64_t next_question = 0;
    while (child_.output.is_open() || child_.messages.is_open()) {
      const std::int64_t now = steady_now_ms();
      if (now >= deadline) return ChildEnd::kTimeout;
      if (now >= next_question) {
        if (!watch_.keep_going()) return ChildEnd::kStopped;
        next_question = now + kTickMs;
      }
      if (!serve_once()) return ChildEnd::kResource;
    }
    return std::nullopt;
  }

  const std::string& messages() const { return messages_; }

 private:
  bool serve_once() {
    std::array<pollfd, 3> waits = {
        {{child_.input.get(), POLLOUT, 0}, {child_.output.get(), POLLIN, 0}, {child_.messages.get(), POLLIN, 0}}};
    if (::poll(waits.data(), waits.size(), kTickMs) <= 0) return true;
    if (waits[0].revents) feed();
    if (waits[2].revents) {
      read_some(child_.messages, [&](std::string_view bytes) { keep_last(bytes); });
    }
    bool within_bounds = true;
    if (waits[1].revents) {
      read_some(child_.output, [&](std::string_view bytes) { within_bounds = lines_.take(bytes); });
    }
    return within_bounds;
  }

  void feed() {
    const ssize_t written = ::write(child_.input.get(), input_.data(), input_.size());
    if (written < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (written > 0) input_.remove_prefix(static_cast<std::size_t>(written));
    if (written < 0 || input_.empty()) child_.input.close();
  }

  template <typename Take>
  static void read_some(FileDescriptor& from, const Take& take) {
    std::array<char, 65536> piece;
    const ssize_t got = ::read(from.get(), piece.data(), piece.size());
    if (got > 0) take(std::string_view(piece.data(), static_cast<std::size_t>(got)));
    if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) from.close();
  }

  void keep_last(std::string_view bytes) {
    messages_ += bytes;
    if (messages_.size() > limits_.messages_bytes) messages_.erase(0, messages_.size() - limits_.messages_bytes);
  }

  Running& child_;
  std::string_view input_;
  const ChildLimits& limits_;
  const ChildWatch& watch_;
  LineReader lines_;
  std::string messages_;
};

/// A child that dies while we write to it is its end, not ours.
void block_broken_pipe_signal() {
  sigset_t broken_pipe;
  ::sigemptyset(&broken_pipe);
  ::sigaddset(&broken_pipe, SIGPIPE);
  ::pthread_sigmask(SIG_BLOCK, &broken_pipe, nullptr);
}

/// Waits for the end; a child that has closed its pipes but does not end gets a second.
int reap(pid_t pid, bool kill_now) {
  int status = 0;
  for (int tick = 0; !kill_now && tick < 100; ++tick) {
    if (::waitpid(pid, &status, WNOHANG) == pid) return status;
    ::usleep(tick < 10 ? 500 : 10'000);
  }
  ::kill(pid, SIGKILL);
  while (::waitpid(pid, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}

ChildOutcome outcome_of(int status, const std::optional<ChildEnd>& forced, std::string messages) {
  if (forced) return {*forced, 0, std::move(messages)};
  if (WIFEXITED(status)) return {ChildEnd::kExited, WEXITSTATUS(status), std::move(messages)};
  const int signal = WTERMSIG(status);
  if (signal == SIGXCPU) return {ChildEnd::kTimeout, signal, std::move(messages)};
  if (signal == SIGXFSZ) return {ChildEnd::kResource, signal, std::move(messages)};
  return {ChildEnd::kSignal, signal, std::move(messages)};
}

}  // namespace

Result<ChildOutcome> run_child_process(const std::vector<std::string>& command, std::string_view input,
                                       const ChildLimits& limits, const ChildWatch& watch) {
  block_broken_pipe_signal();
  auto child = start(command, limits);
  if (!child) return tl::unexpected(child.error());
  Conversation conversation(*child, input, limits, watch);
  const std::optional<ChildEnd> forced = conversation.hold();
  const int status = reap(child->pid, forced.has_value());
  return outcome_of(status, forced, conversation.messages());
}

}  // namespace valvetriage
