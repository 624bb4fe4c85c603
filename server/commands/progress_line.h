#pragma once

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <string>

#include "core/stage.h"

namespace valvetriage {

/// One line on a terminal that is written over, and is gone when this is; nothing elsewhere.
class ProgressLine {
 public:
  ProgressLine() = default;
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;
  ~ProgressLine() {
    if (terminal_) fmt::print(stderr, "\r\033[K");
  }

  void show(const std::string& text) const {
    if (terminal_) fmt::print(stderr, "\r\033[K{}", text.substr(0, 100));
  }

  /// Shows what a computation is at. Must not outlive the line.
  StageReport stages() const {
    return [this](double done, std::string_view next) { show(fmt::format("{:3.0f} %  {}", 100 * done, next)); };
  }

 private:
  bool terminal_ = isatty(STDERR_FILENO) != 0;
};

}  // namespace valvetriage
