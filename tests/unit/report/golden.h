#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

namespace valvetriage::report {

inline std::string file_text(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// `text` is what the golden file says, to the byte. VALVETRIAGE_WRITE_GOLDEN=1 writes the files anew: look at them
/// before they are committed.
inline void expect_golden(const std::string& name, const std::string& text) {
  const std::string path = std::string(VALVETRIAGE_GOLDEN_DIR) + "/" + name;
  if (std::getenv("VALVETRIAGE_WRITE_GOLDEN")) std::ofstream(path) << text;
  EXPECT_EQ(text, file_text(path)) << path;
}

}  // namespace valvetriage::report
