#include "core/model/mode.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

namespace valvetriage {
namespace {

constexpr double kModePeriod_s = 0.005;

TEST(Mode, FollowsAParabolaToTheLastBitsOfItsSettledAnswer) {
  // y = u − 2 ζ/ω u̇ + (4 ζ² − 1)/ω² ü of a parabola, once all ringing has died.
  for (const Mode& mode : {Mode{40, 0.3}, Mode{40, 1}, Mode{25, 2}}) {
    std::vector<double> signal(2000);
    const auto u = [](double t) { return 3 + 2 * t - 0.5 * t * t; };
    for (std::size_t i = 0; i < signal.size(); ++i) signal[i] = u(kModePeriod_s * static_cast<double>(i));
    read_behind_mode(mode, kModePeriod_s, signal);
    const double t = kModePeriod_s * 1999, w = mode.natural_frequency_rad_s, z = mode.damping_ratio;
    EXPECT_NEAR(signal.back(), u(t) - 2 * z / w * (2 - t) - (4 * z * z - 1) / (w * w), 1e-9) << z;
  }
}

TEST(Mode, RingsAtItsFrequencyAndDiesAtItsDamping) {
  // What a pulse leaves, a period of its ringing apart.
  const double root = std::sqrt(1 - 0.1 * 0.1), omega = 2 * std::numbers::pi / (root * 20 * kModePeriod_s);
  std::vector<double> signal(200, 7.0);
  signal[3] = 8;
  read_behind_mode({omega, 0.1}, kModePeriod_s, signal);
  const double dies = std::exp(-0.1 * omega * 20 * kModePeriod_s);
  for (std::size_t i = 20; i + 20 < signal.size(); ++i) {
    EXPECT_NEAR(signal[i + 20] - 7, dies * (signal[i] - 7), 1e-12) << i;
  }
  EXPECT_GT(std::abs(signal[25] - 7), 0.01);
}

}  // namespace
}  // namespace valvetriage
