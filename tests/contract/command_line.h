#pragma once

#include <string>
#include <vector>

namespace valvetriage::test {

/// How a command ended, and what it said.
struct Outcome {
  int status = -1;  ///< exit status; -1 where a signal ended it
  std::string out;
  std::string err;
};

/// Runs a program with arguments that are passed as they are; standard input is empty.
Outcome run_program(const std::string& program, const std::vector<std::string>& arguments);

/// The product, and the virtual stand, as the build made them.
inline Outcome valvetriage(const std::vector<std::string>& arguments) {
  return run_program(VALVETRIAGE_BINARY, arguments);
}
inline Outcome stand(const std::vector<std::string>& arguments) {
  return run_program(VALVETRIAGE_STAND_BINARY, arguments);
}

}  // namespace valvetriage::test
