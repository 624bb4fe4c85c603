#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace {

/// Every line of the folder's sources that includes something of one of the `forbidden` folders.
std::vector<std::string> includes_of(const std::string& folder, const std::vector<std::string>& forbidden) {
  std::vector<std::string> found;
  for (const auto& entry :
       std::filesystem::recursive_directory_iterator(std::string(VALVETRIAGE_SOURCE_DIR "/") + folder)) {
    const std::string suffix = entry.path().extension();
    if (suffix != ".h" && suffix != ".cpp" && suffix != ".txt") continue;
    std::ifstream file(entry.path());
    for (std::string line; std::getline(file, line);)
      for (const std::string& name : forbidden)
        if ((line.find("#include") != std::string::npos && line.find(name) != std::string::npos) ||
            (suffix == ".txt" && line.find(name) != std::string::npos))
          found.push_back(entry.path().string() + ": " + line);
  }
  return found;
}

TEST(Stand, SharesNothingWithTheProduct) {
  EXPECT_EQ(includes_of("tests/stand", {"core/", "server/", "valvetriage_core", "valvetriage_server"}),
            std::vector<std::string>{});
}

TEST(HiddenEffects, AreMeasuredWithoutTheProduct) {
  EXPECT_EQ(includes_of("tests/hidden_effects", {"core/", "server/", "valvetriage_core", "valvetriage_server"}),
            std::vector<std::string>{});
}

TEST(Stand, IsUnknownToTheProduct) {
  EXPECT_EQ(includes_of("core", {"tests/"}), std::vector<std::string>{});
  EXPECT_EQ(includes_of("server", {"tests/"}), std::vector<std::string>{});
}

}  // namespace
