#include "server/commands/commands.h"

#include <fmt/format.h>

#include <cstdio>

namespace valvetriage {

void print_error(const Error& error) {
  if (error.file.empty()) {
    fmt::print(stderr, "valvetriage: {}\n", error.message);
  } else {
    fmt::print(stderr, "valvetriage: {}: {}\n", error.file, error.message);
  }
}

ExitStatus ended_by(const Error& error) {
  print_error(error);
  return error.code == "cannot_write" || error.code == "internal" ? kFailure : kBadInput;
}

}  // namespace valvetriage
