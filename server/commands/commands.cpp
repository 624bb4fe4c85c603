#include "server/commands/commands.h"

#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <string_view>

namespace valvetriage {

void keep_freed_memory() {
  constexpr int kLargestKept = 32 << 20;  // the C library takes no larger threshold
  constexpr int kMostKept = 256 << 20;
  mallopt(M_MMAP_THRESHOLD, kLargestKept);
  mallopt(M_TRIM_THRESHOLD, kMostKept);
}

void print_error(const Error& error) {
  if (error.file.empty()) {
    fmt::print(stderr, "valvetriage: {}\n", error.message);
  } else {
    fmt::print(stderr, "valvetriage: {}: {}\n", error.file, error.message);
  }
}

ExitStatus ended_by(const Error& error) {
  print_error(error);
  static constexpr std::string_view kFailures[] = {"cannot_write", "internal", "no_connection", "no_chromium"};
  return std::find(std::begin(kFailures), std::end(kFailures), error.code) != std::end(kFailures) ? kFailure
                                                                                                  : kBadInput;
}

}  // namespace valvetriage
