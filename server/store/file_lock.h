#pragma once

#include <string>

#include "core/result.h"

namespace valvetriage {

/// A lock between processes, held as long as it lives; the kernel lets go of it with the process, however that ends.
class FileLock {
 public:
  /// Makes the file where it is missing. A lock that is let go of within a second is waited for: a server that is
  /// killed between fork and exec of a child leaves its lock with that child until the child sees its parent gone.
  ///
  /// what    that the lock stands for, as an error says it: "this database"
  /// Errors  `store_locked` another process holds it; `store_broken` the file cannot be opened
  static Result<FileLock> take(const std::string& path, const std::string& what);

  FileLock(FileLock&& other) noexcept;
  FileLock& operator=(FileLock&&) = delete;
  ~FileLock();

 private:
  explicit FileLock(int fd) : fd_(fd) {}

  int fd_;
};

/// One process at a time serves from a data folder, or brings a backup back into it. Errors  as FileLock::take
Result<FileLock> lock_data_folder(const std::string& data_dir);

}  // namespace valvetriage
