#include "server/report/bode_text.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

#include "core/model/paper_models.h"

namespace valvetriage::report {
namespace {

/// Column of a sign in each row, −1 where it is not; the picture begins at column 9.
std::vector<int> columns_of(const std::string& text, char sign) {
  std::istringstream lines(text);
  std::vector<int> columns;
  for (std::string line; columns.size() < 16 && std::getline(lines, line);) {
    const auto at = line.find(sign, 9);
    columns.push_back(at == std::string::npos ? -1 : static_cast<int>(at) - 9);
  }
  return columns;
}

TEST(BodeText, DrawsALagWhereItIs) {
  const TransferFunction lag{.domain = Domain::kS, .poles = {{-1, 0}}, .gain = 3};
  const auto columns = columns_of(bode_text({{"a lag", '*', lag}}, 0.01, 100, -45), '*');
  // Rows are 3 dB apart, columns a decade in 17.75: -3 dB at 1, the middle; -39 dB at 89, column 70.
  EXPECT_EQ(columns[0], 0);
  EXPECT_NEAR(columns[1], 35, 4);
  EXPECT_NEAR(columns[13], 70, 2);
}

TEST(BodeText, ShowsThatThePapersReturnedValveDecaysFirst) {
  const std::string text = bode_text(
      {{"good", 'g', cancelled(kPaperEquation16)}, {"returned", 'r', cancelled(kPaperEquation17)}}, 0.1, 100, -60);
  const auto good = columns_of(text, 'g'), returned = columns_of(text, 'r');
  for (std::size_t row = 1; row < 15; ++row) {
    if (good[row] < 0 || returned[row] < 0) continue;
    EXPECT_LT(returned[row], good[row]) << text;
  }
  EXPECT_GT(std::count_if(returned.begin(), returned.end(), [](int c) { return c >= 0; }), 8) << text;
}

}  // namespace
}  // namespace valvetriage::report
