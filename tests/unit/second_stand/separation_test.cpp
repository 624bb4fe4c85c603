#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace {

/// Lines of the folder's sources and build files that name another part of the tree.
std::vector<std::string> uses(const std::string& folder, const std::vector<std::string>& others) {
  std::vector<std::string> found;
  for (const auto& entry : std::filesystem::directory_iterator(std::string(VALVETRIAGE_SOURCE_DIR "/") + folder)) {
    if (entry.path().extension() == ".md") continue;
    std::ifstream file(entry.path());
    for (std::string line; std::getline(file, line);)
      for (const std::string& other : others)
        if (line.find(other) != std::string::npos) found.push_back(entry.path().filename().string() + ": " + line);
  }
  return found;
}

TEST(SecondStand, SharesNothingWithTheProductOrTheFirstStand) {
  EXPECT_EQ(uses("tests/second_stand", {"core/", "server/", "tests/stand", "valvetriage_core", "valvetriage_server",
                                        "valvetriage_stand", "valvetriage::stand"}),
            std::vector<std::string>{});
}

TEST(SecondStand, IsUnknownToTheFirst) {
  EXPECT_EQ(uses("tests/stand", {"second_stand"}), std::vector<std::string>{});
}

}  // namespace
