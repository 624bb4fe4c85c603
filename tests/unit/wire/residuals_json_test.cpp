#include "server/wire/residuals_json.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace valvetriage {
namespace {

TEST(ResidualsJson, KeepsFiveDigitsAndWhereNothingWasMeasured) {
  BinnedResidual residual{.value = Eigen::Vector3d(1.2345678, std::numeric_limits<double>::quiet_NaN(), -2e-7),
                          .time_s = {0.5, 1.5, 2.5},
                          .white_sd = 0.05};
  const auto read = residuals_from_json(residuals_to_json({{"step, 3.0 s", residual}}));
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->size(), 1u);
  const BinnedResidual& again = read->at("step, 3.0 s");
  EXPECT_DOUBLE_EQ(again.value(0), 1.2346);
  EXPECT_TRUE(std::isnan(again.value(1)));
  EXPECT_DOUBLE_EQ(again.value(2), -2e-7);
  EXPECT_EQ(again.time_s, residual.time_s);
  EXPECT_EQ(again.white_sd, 0.05);
}

TEST(ResidualsJson, RefusesValuesThatDoNotFitTheirTimes) {
  for (const char* text : {"[]", R"({"a": 1})", R"({"a": {"value": [1], "time_s": [1, 2], "white_sd": 1}})",
                           R"({"a": {"value": [1], "time_s": [1]}})"}) {
    EXPECT_FALSE(residuals_from_json(text)) << text;
  }
}

}  // namespace
}  // namespace valvetriage
