#include "server/store/file_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <chrono>
#include <thread>
#include <utility>

namespace valvetriage {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kLockPatience{1000};
constexpr milliseconds kLockPoll{10};

}  // namespace

Result<FileLock> FileLock::take(const std::string& path, const std::string& what) {
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640);
  if (fd < 0) return fail("store_broken", fmt::format("cannot open the lock file {}", path));
  FileLock lock(fd);
  const auto last_try = steady_clock::now() + kLockPatience;
  for (; ::flock(fd, LOCK_EX | LOCK_NB) != 0; std::this_thread::sleep_for(kLockPoll)) {
    if (steady_clock::now() >= last_try) {
      return fail("store_locked", fmt::format("another valvetriage has {} open ({}): stop it first", what, path));
    }
  }
  return lock;
}

FileLock::FileLock(FileLock&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}

FileLock::~FileLock() {
  if (fd_ >= 0) ::close(fd_);
}

Result<FileLock> lock_data_folder(const std::string& data_dir) {
  return FileLock::take(data_dir + "/serve.lock", "this data folder");
}

}  // namespace valvetriage
