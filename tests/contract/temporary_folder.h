#pragma once

#include <stdlib.h>

#include <filesystem>
#include <string>

namespace valvetriage::test {

/// An empty folder that vanishes with the object: in memory where the machine has such a place, unless the disk itself
/// is what is measured.
class TemporaryFolder {
 public:
  enum class Where { kMemory, kDisk };

  explicit TemporaryFolder(Where where = Where::kMemory) {
    const std::filesystem::path memory = "/dev/shm";
    const bool in_memory = where == Where::kMemory && std::filesystem::is_directory(memory);
    const auto base = in_memory ? memory : std::filesystem::temp_directory_path();
    std::string pattern = (base / "valvetriage-XXXXXX").string();
    path_ = ::mkdtemp(pattern.data());
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  const std::string& path() const { return path_; }
  std::string file(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

}  // namespace valvetriage::test
