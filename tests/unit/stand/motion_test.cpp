#include "tests/stand/motion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <stdexcept>

#include "tests/unit/stand/played.h"

namespace valvetriage::stand {
namespace {

Session motion(std::vector<EffectRequest> effects = {}) {
  return run_motion(session_of({}, std::move(effects)));
}

TEST(Motion, HealthyPlantIsLinear) {
  // The same excitation three times as large gives three times the output: to the integrator's tolerance.
  const Session healthy = motion();
  const auto &low = healthy.recordings[0].clean_psi, &high = healthy.recordings[1].clean_psi;
  for (std::size_t k = 0; k < low.size(); ++k) EXPECT_NEAR(high[k], 3 * low[k], 1e-3);
}

TEST(Motion, RectifiedSensorShowsMagnitudes) {
  const Session healthy = motion(), rectified = motion({{"rectified_sensor", 1}});
  for (std::size_t k = 0; k < 4000; ++k)
    EXPECT_EQ(rectified.recordings[0].clean_psi[k], std::abs(healthy.recordings[0].clean_psi[k]));
}

TEST(Motion, StiffSpringHoldsLargeTravelBack) {
  const Session healthy = motion(), stiff = motion({{"stiffening_spring", 0.5}});
  const auto peak = [](const Session& s, std::size_t i) {
    return *std::max_element(s.recordings[i].clean_psi.begin(), s.recordings[i].clean_psi.end());
  };
  EXPECT_LT(peak(stiff, 1) / peak(healthy, 1), 0.9);
}

TEST(Motion, EveryEffectMovesTheOutput) {
  const Session healthy = motion();
  for (const std::string& effect : motion_effects()) {
    const Session spoiled = motion({{effect, effect == "rectified_sensor" ? 1 : 0.5}});
    EXPECT_GT(rms_difference(healthy.recordings[1].clean_psi, spoiled.recordings[1].clean_psi), 0.02) << effect;
  }
}

TEST(Motion, EffectOfTheValveAloneIsRefused) {
  EXPECT_THROW(motion({{"leakage", 0.1}}), std::invalid_argument);
}

}  // namespace
}  // namespace valvetriage::stand
