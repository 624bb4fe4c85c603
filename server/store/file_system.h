#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace valvetriage {

struct DirectoryEntry {
  std::string name;
  bool is_directory = false;
  std::int64_t modified_ms = 0;  ///< wall clock, ms since 1970
};

/// The file operations that durability hangs on, one system call each, so that tests can fail the N-th and can forget
/// what was never synced. Thread-safe.
///
/// Errors  `no_space` (disk or quota full), `read_only` (file system is read-only), `not_found`, else `io_error`; the
///         message names the operation and the path
class FileSystem {
 public:
  virtual ~FileSystem() = default;

  /// A new file, open for writing; it must not exist.
  virtual Result<int> create(const std::string& path) = 0;
  virtual Result<int> open_read(const std::string& path) = 0;
  /// Writes all of `bytes`.
  virtual Result<void> write(int fd, std::string_view bytes) = 0;
  /// At most `size` bytes; 0 at the end.
  virtual Result<std::size_t> read(int fd, char* into, std::size_t size) = 0;
  /// The file's content is on the disk when this returns.
  virtual Result<void> sync(int fd) = 0;
  virtual Result<void> set_mode(int fd, unsigned mode) = 0;
  virtual void close(int fd) = 0;
  /// Replaces `to` where it exists.
  virtual Result<void> rename(const std::string& from, const std::string& to) = 0;
  virtual Result<void> remove(const std::string& path) = 0;
  virtual Result<bool> exists(const std::string& path) = 0;
  /// True if it was made, false if it was there.
  virtual Result<bool> make_directory(const std::string& path) = 0;
  /// The names in the folder are on the disk when this returns.
  virtual Result<void> sync_directory(const std::string& path) = 0;
  virtual Result<std::vector<DirectoryEntry>> list(const std::string& path) = 0;
  virtual Result<std::int64_t> free_bytes(const std::string& path) = 0;
};

/// The machine's own.
FileSystem& posix_file_system();

}  // namespace valvetriage
