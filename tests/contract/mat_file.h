#pragma once

#include <map>
#include <string>
#include <vector>

namespace valvetriage::test {

/// A MAT v5 file, not packed, byte by byte as its format describes it: a row of doubles for each number, of UTF-16 for
/// each text (ASCII here).
std::string mat_file(const std::map<std::string, std::vector<double>>& numbers,
                     const std::map<std::string, std::string>& texts);

/// 400 samples of steps with a first-order response, with these texts in it.
std::string good_mat(const std::map<std::string, std::string>& texts);

}  // namespace valvetriage::test
