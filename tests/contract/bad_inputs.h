#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace valvetriage {

/// One bad recording of bad_inputs/ and what every way into the product says about it (bad_inputs/expected.csv).
struct BadInput {
  std::string name;
  std::string file;  ///< path
  std::string text;
  std::string code;
  std::optional<std::size_t> line, column;  ///< where the problem must point, if it must
};

/// All of them, from the folder VALVETRIAGE_BAD_INPUTS that the build sets. Throws where it cannot be read.
std::vector<BadInput> bad_inputs();

}  // namespace valvetriage
