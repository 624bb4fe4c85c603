#include "core/residual/residual_signature.h"

#include <gtest/gtest.h>

#include <cmath>

namespace valvetriage {
namespace {

Recording ramp(std::size_t samples) {
  Recording recording;
  recording.sample_period_s = 0.01;
  recording.input.values.assign(samples, 1);
  for (std::size_t i = 0; i < samples; ++i) recording.output.values.push_back(static_cast<double>(i));
  return recording;
}

TEST(BinnedResidual, IsTheMeanOverRunsOfEqualLength) {
  const BinnedResidual binned = binned_residual(ramp(100), std::vector<double>(100, 0), 4);
  ASSERT_EQ(binned.value.size(), 4);
  EXPECT_DOUBLE_EQ(binned.value(0), 12);
  EXPECT_DOUBLE_EQ(binned.value(3), 87);
  EXPECT_DOUBLE_EQ(binned.time_s[0], 0.125);
}

TEST(BinnedResidual, LeavesOutWhatIsNotValid) {
  Recording recording = ramp(100);
  recording.valid.assign(100, 1);
  for (std::size_t i = 0; i < 30; ++i) recording.valid[i] = 0;
  const BinnedResidual binned = binned_residual(recording, std::vector<double>(100, 0), 4);
  EXPECT_TRUE(std::isnan(binned.value(0)));
  EXPECT_DOUBLE_EQ(binned.value(1), 39.5);
}

TEST(ResidualDirections, TakeOffWhatGoodValvesLeaveAndCountTheirScatterAsNoise) {
  Eigen::MatrixXd good(2, 2), residuals(1, 2);
  good << 1, -2, 1, 2;  // the second place scatters by 2 around 0
  residuals << 4, 3;
  const Eigen::MatrixXd s = residual_directions(residuals, good, Eigen::Vector2d(1, 1));
  // d₁² = (1 + 0) / 3, d₂² = (1 + 8) / 3: the offset of 3 weighs three times as much in the first place
  EXPECT_NEAR(s(0, 0) / s(0, 1), 3, 1e-12);
  EXPECT_NEAR(s.row(0).norm(), 1, 1e-12);
}

TEST(ResidualDirections, OfAValveThatLeavesNothingAreZero) {
  EXPECT_EQ(residual_directions(Eigen::MatrixXd::Zero(1, 3), Eigen::MatrixXd(0, 3), Eigen::Vector3d(1, 1, 1)).norm(),
            0);
}

}  // namespace
}  // namespace valvetriage
