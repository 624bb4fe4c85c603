#include "server/store/file_system.h"

#include <dirent.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>

namespace valvetriage {
namespace {

constexpr mode_t kFileMode = 0640;
constexpr mode_t kDirectoryMode = 0750;

const char* code_of(int error) {
  switch (error) {
    case ENOSPC:
    case EDQUOT:
      return "no_space";
    case EROFS:
      return "read_only";
    case ENOENT:
      return "not_found";
    default:
      return "io_error";
  }
}

tl::unexpected<Error> failed(std::string_view operation, std::string_view subject) {
  const int error = errno;
  return fail(code_of(error), fmt::format("cannot {} {}: {}", operation, subject, std::strerror(error)));
}

class PosixFileSystem final : public FileSystem {
 public:
  Result<int> create(const std::string& path) override {
    return opened(::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, kFileMode), "create",
                  path);
  }

  Result<int> open_read(const std::string& path) override {
    return opened(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW), "open", path);
  }

  Result<void> write(int fd, std::string_view bytes) override {
    while (!bytes.empty()) {
      const ssize_t written = ::write(fd, bytes.data(), bytes.size());
      if (written < 0 && errno == EINTR) continue;
      if (written < 0) return failed("write", "a stored file");
      bytes.remove_prefix(static_cast<std::size_t>(written));
    }
    return {};
  }

  Result<std::size_t> read(int fd, char* into, std::size_t size) override {
    for (;;) {
      const ssize_t got = ::read(fd, into, size);
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return failed("read", "a stored file");
      return static_cast<std::size_t>(got);
    }
  }

  Result<void> sync(int fd) override { return done(::fsync(fd), "sync", "a stored file"); }
  Result<void> set_mode(int fd, unsigned mode) override {
    return done(::fchmod(fd, static_cast<mode_t>(mode)), "set the mode of", "a stored file");
  }
  void close(int fd) override { ::close(fd); }

  Result<void> rename(const std::string& from, const std::string& to) override {
    return done(std::rename(from.c_str(), to.c_str()), "rename to", to);
  }
  Result<void> remove(const std::string& path) override { return done(::unlink(path.c_str()), "remove", path); }

  Result<bool> exists(const std::string& path) override {
    struct stat info {};
    if (::lstat(path.c_str(), &info) == 0) return true;
    if (errno == ENOENT) return false;
    return failed("look at", path);
  }

  Result<bool> make_directory(const std::string& path) override {
    if (::mkdir(path.c_str(), kDirectoryMode) == 0) return true;
    if (errno == EEXIST) return false;
    return failed("make folder", path);
  }

  Result<void> sync_directory(const std::string& path) override {
    const auto fd = opened(::open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC), "open folder", path);
    if (!fd) return tl::unexpected(fd.error());
    const auto synced = done(::fsync(*fd), "sync folder", path);
    ::close(*fd);
    return synced;
  }

  Result<std::vector<DirectoryEntry>> list(const std::string& path) override {
    const std::unique_ptr<DIR, int (*)(DIR*)> folder(::opendir(path.c_str()), ::closedir);
    if (!folder) return failed("list folder", path);
    std::vector<DirectoryEntry> entries;
    while (const dirent* entry = ::readdir(folder.get())) {
      const std::string_view name = entry->d_name;
      if (name == "." || name == "..") continue;
      struct stat info {};
      if (::fstatat(::dirfd(folder.get()), entry->d_name, &info, AT_SYMLINK_NOFOLLOW) != 0) continue;  // gone meanwhile
      const std::int64_t modified_ms = std::int64_t{info.st_mtim.tv_sec} * 1000 + info.st_mtim.tv_nsec / 1'000'000;
      entries.push_back({std::string(name), S_ISDIR(info.st_mode), modified_ms});
    }
    return entries;
  }

  Result<std::int64_t> free_bytes(const std::string& path) override {
    struct statvfs info {};
    if (::statvfs(path.c_str(), &info) != 0) return failed("measure the disk at", path);
    return static_cast<std::int64_t>(info.f_bavail) * static_cast<std::int64_t>(info.f_frsize);
  }

 private:
  static Result<int> opened(int fd, std::string_view operation, std::string_view path) {
    if (fd < 0) return failed(operation, path);
    return fd;
  }

  static Result<void> done(int status, std::string_view operation, std::string_view subject) {
    if (status != 0) return failed(operation, subject);
    return {};
  }
};

}  // namespace

FileSystem& posix_file_system() {
  static PosixFileSystem files;
  return files;
}

}  // namespace valvetriage
