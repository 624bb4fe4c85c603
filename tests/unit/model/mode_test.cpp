#include "core/model/mode.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace valvetriage {
namespace {

constexpr double kPeriod_s = 0.005;

TEST(Mode, FollowsAParabolaToTheLastBitsOfItsSettledAnswer) {
  // y = u − 2 ζ/ω u̇ + (4 ζ² − 1)/ω² ü of a parabola, once all ringing has died.
  for (const Mode& mode : {Mode{40, 0.3}, Mode{40, 1}, Mode{25, 2}}) {
    std::vector<double> signal(2000);
    const auto u = [](double t) { return 3 + 2 * t - 0.5 * t * t; };
    for (std::size_t i = 0; i < signal.size(); ++i) signal[i] = u(kPeriod_s * static_cast<double>(i));
    read_behind_mode(mode, kPeriod_s, signal);
    const double t = kPeriod_s * 1999, w = mode.natural_frequency_rad_s, z = mode.damping_ratio;
    EXPECT_NEAR(signal.back(), u(t) - 2 * z / w * (2 - t) - (4 * z * z - 1) / (w * w), 1e-9) << z;
  }
}

TEST(Mode, OffItsRestRingsAtItsFrequencyAndDiesAtItsDamping) {
  const Mode mode{40, 0.3};
  std::vector<double> signal(200, 7.0);
  read_behind_mode(mode, kPeriod_s, signal, 2, 0.5);
  const double root = std::sqrt(1 - 0.3 * 0.3);
  for (std::size_t i = 0; i < signal.size(); ++i) {
    const double angle = 40 * kPeriod_s * static_cast<double>(i);
    const double rings = 2 * std::cos(root * angle) + (0.5 + 0.3 * 2) / root * std::sin(root * angle);
    EXPECT_NEAR(signal[i], 7 + std::exp(-0.3 * angle) * rings, 1e-12) << i;
  }
}

}  // namespace
}  // namespace valvetriage
