#include <gtest/gtest.h>

#include <cmath>

#include "tests/second_stand/hydraulics.h"
#include "tests/second_stand/magnet.h"
#include "tests/unit/second_stand/nominal.h"

namespace valvetriage::second_stand {
namespace {

TEST(Unit, SteadyMapRisesForEveryUnit) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const Unit unit = unit_of(draw_latents(seed));
    double before = 0;
    for (double current_a = 0.9; current_a < 2.15; current_a += 0.01) {
      const double now = steady_psi(unit, {}, current_a);
      ASSERT_GT(now, before) << seed << " at " << current_a;
      before = now;
    }
  }
}

TEST(Unit, IsTrimmedAtMidRange) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Unit unit = unit_of(draw_latents(seed));
    EXPECT_NEAR(steady_psi(unit, {}, 1.6), unit.trim_psi, 0.01) << seed;
  }
}

TEST(Unit, NominalMapIsThatOfAFuelControlValve) {
  const Unit unit = nominal_unit();
  EXPECT_NEAR(steady_psi(unit, {}, 1.2), 3.3, 0.5);
  EXPECT_NEAR(steady_psi(unit, {}, 1.4), 33, 2);
  EXPECT_NEAR(steady_psi(unit, {}, 1.6), 112, 0.1);
  EXPECT_NEAR(steady_psi(unit, {}, 1.8), 168, 2);
  EXPECT_NEAR(steady_psi(unit, {}, 2.0), 212, 2);
}

TEST(Unit, TightSpoolsStickMoreAndLeakLess) {
  double products = 0, breakaway = 0, leak = 0;
  constexpr int kUnits = 400;
  for (std::uint64_t seed = 0; seed < kUnits; ++seed) {
    const Unit unit = unit_of(draw_latents(seed));
    const double b = std::log(unit.breakaway_a / Unit{}.breakaway_a) / 0.25;
    const double l = std::log(unit.leak_fraction / Unit{}.leak_fraction) / 0.25;
    products += b * l;
    breakaway += b * b;
    leak += l * l;
  }
  // loadings -0.7 and 0.8: a correlation of -0.56, known to (1 - 0.56²) / √400 = 0.034; four of them
  EXPECT_NEAR(products / std::sqrt(breakaway * leak), -0.56, 0.14);
}

TEST(Unit, EqualSeedsAreEqualUnitsAndOthersDiffer) {
  EXPECT_EQ(draw_latents(5), draw_latents(5));
  EXPECT_NE(draw_latents(5), draw_latents(6));
}

TEST(Unit, EveryLatentMovesTheOutput) {
  Latents latents(latent_names().size(), 0);
  const auto nominal = clean_outputs(order_of({"staircase"}), unit_of(latents));
  for (std::size_t i = 0; i < latents.size(); ++i) {
    latents[i] = 1;
    EXPECT_GT(rms_difference(clean_outputs(order_of({"staircase"}), unit_of(latents)), nominal), 1e-5)
        << latent_names()[i];
    latents[i] = 0;
  }
}

}  // namespace
}  // namespace valvetriage::second_stand
