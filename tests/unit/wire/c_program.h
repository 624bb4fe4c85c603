#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// A model in C, compiled, fed with the recording's input, steps and first side channel, and its output read back.
inline std::vector<double> run_in_c(const std::string& source, const Recording& recording) {
  namespace fs = std::filesystem;
  const fs::path folder = fs::temp_directory_path() / fmt::format("valvetriage_c_{}", ::getpid());
  fs::create_directories(folder);
  std::ofstream(folder / "model.c") << source;
  std::ofstream input(folder / "input");
  std::vector<int> is_step(recording.input.values.size(), 0);
  for (const Segment& segment : recording.segments) is_step[segment.begin] = segment.begins_with_jump();
  for (std::size_t i = 0; i < is_step.size(); ++i) {
    input << fmt::format("{:.17g} {} {:.17g}\n", recording.input.values[i], is_step[i], recording.side[0].values[i]);
  }
  input.close();
  const std::string compile =
      fmt::format("{} -std=c99 -O1 -Wall -Wextra -Werror -pedantic -DVALVETRIAGE_MAIN -o {}/model {}/model.c -lm",
                  VALVETRIAGE_C_COMPILER, folder.string(), folder.string());
  EXPECT_EQ(std::system(compile.c_str()), 0) << source;
  EXPECT_EQ(std::system(fmt::format("{0}/model < {0}/input > {0}/output", folder.string()).c_str()), 0);
  std::ifstream output(folder / "output");
  std::vector<double> y;
  for (std::string text; output >> text;) y.push_back(std::strtod(text.c_str(), nullptr));
  fs::remove_all(folder);
  return y;
}

}  // namespace valvetriage
