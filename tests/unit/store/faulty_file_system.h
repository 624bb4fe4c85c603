#pragma once

#include <string>

#include "server/store/file_system.h"

namespace valvetriage::test {

/// The real file system, whose operation number `fail_at` (1-based) fails, once or from then on for ever.
class FaultyFileSystem final : public FileSystem {
 public:
  int fail_at = 0;
  bool for_ever = false;
  int operations = 0;

  Result<int> create(const std::string& path) override {
    return or_fault([&] { return real_.create(path); });
  }
  Result<int> open_read(const std::string& path) override {
    return or_fault([&] { return real_.open_read(path); });
  }
  Result<void> write(int fd, std::string_view bytes) override {
    return or_fault([&] { return real_.write(fd, bytes); });
  }
  Result<std::size_t> read(int fd, char* into, std::size_t size) override {
    return or_fault([&] { return real_.read(fd, into, size); });
  }
  Result<void> sync(int fd) override {
    return or_fault([&] { return real_.sync(fd); });
  }
  Result<void> set_mode(int fd, unsigned mode) override {
    return or_fault([&] { return real_.set_mode(fd, mode); });
  }
  void close(int fd) override { real_.close(fd); }
  Result<void> rename(const std::string& from, const std::string& to) override {
    return or_fault([&] { return real_.rename(from, to); });
  }
  Result<void> remove(const std::string& path) override {
    return or_fault([&] { return real_.remove(path); });
  }
  Result<bool> exists(const std::string& path) override {
    return or_fault([&] { return real_.exists(path); });
  }
  Result<bool> make_directory(const std::string& path) override {
    return or_fault([&] { return real_.make_directory(path); });
  }
  Result<void> sync_directory(const std::string& path) override {
    return or_fault([&] { return real_.sync_directory(path); });
  }
  Result<std::vector<DirectoryEntry>> list(const std::string& path) override {
    return or_fault([&] { return real_.list(path); });
  }
  Result<std::int64_t> free_bytes(const std::string& path) override {
    return or_fault([&] { return real_.free_bytes(path); });
  }

 private:
  template <typename Operation>
  auto or_fault(const Operation& operation) -> decltype(operation()) {
    ++operations;
    if (fail_at > 0 && (operations == fail_at || (for_ever && operations > fail_at)))
      return fail("io_error", "a fault");
    return operation();
  }

  FileSystem& real_ = posix_file_system();
};

}  // namespace valvetriage::test
