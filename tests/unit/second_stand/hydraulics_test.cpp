#include <gtest/gtest.h>

#include <cmath>

#include "tests/second_stand/hydraulics.h"
#include "tests/second_stand/port.h"
#include "tests/unit/second_stand/nominal.h"

namespace valvetriage::second_stand {
namespace {

TEST(Port, FlowIsLaminarAtFirstAndTurbulentLater) {
  const auto slope = [](double drop) {
    return std::log(port_flow(100, 1.01 * drop) / port_flow(100, drop)) / std::log(1.01);
  };
  EXPECT_NEAR(slope(0.1), 1, 0.02);
  EXPECT_NEAR(slope(250), 0.5, 0.03);
  EXPECT_EQ(port_flow(100, 0), 0);
}

TEST(Port, AreaRisesWithLiftForEveryUnit) {
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    const LiftTable area = port_area(unit_of(draw_latents(seed)));
    for (std::size_t k = 1; k < area.size(); ++k) ASSERT_GT(area(area.lift_mm(k)), area(area.lift_mm(k - 1))) << seed;
  }
}

TEST(Port, BlankLandHoldsTheAreaAndCostsItsWidth) {
  Faults faults;
  faults.blank_from_a = 1.6;
  faults.blank_a = 0.02;
  const Unit unit = nominal_unit();
  const double before = steady_psi(unit, faults, 1.6);
  EXPECT_NEAR(before, steady_psi(unit, {}, 1.6), 1e-9);
  EXPECT_NEAR(steady_psi(unit, faults, 1.61), before, 1e-6);
  EXPECT_NEAR(steady_psi(unit, faults, 1.62), before, 1e-6);
  EXPECT_LT(steady_psi(unit, faults, 1.8), steady_psi(unit, {}, 1.8) - 1);
}

TEST(Port, CurvatureIsThatOfTheContract) {
  Faults faults;
  faults.curvature = -0.2;
  const Unit unit = nominal_unit();
  for (const double current_a : {1.3, 1.5, 1.6, 1.8}) {
    const double straight = steady_psi(unit, {}, current_a), q = straight / kRangePsi;
    EXPECT_NEAR(steady_psi(unit, faults, current_a), straight - 0.2 * kRangePsi * q * (1 - q), 0.05) << current_a;
  }
}

TEST(Outlet, ExponentMovesAndTheFlowAt120Stays) {
  const Unit unit = nominal_unit();
  const Outlet healthy(unit), gummed(unit, 0.1);
  EXPECT_NEAR(gummed.exponent_at_120(), healthy.exponent_at_120() + 0.1, 1e-9);
  EXPECT_NEAR(gummed.through(120), healthy.through(120), 1e-9);
  EXPECT_LT(gummed.through(30), healthy.through(30));
}

TEST(Outlet, LeakIsAShareOfTheThroughFlowAtTheHighestLevel) {
  const Unit unit = nominal_unit();
  const Outlet healthy(unit), leaking(unit, 0, 0.1);
  EXPECT_NEAR(leaking.leak(kRangePsi) - healthy.leak(kRangePsi), 0.1 * healthy.through(kRangePsi), 1e-9);
}

TEST(Volume, BalanceIsWhereNothingIsLeftOver) {
  const Outlet outlet(nominal_unit());
  for (const double pressure : {2.0, 30.0, 120.0, 210.0}) {
    const double area = area_for(pressure, outlet);
    EXPECT_NEAR(port_flow(area, kSupplyPsi - pressure), outlet.flow(pressure), 1e-6);
    EXPECT_NEAR(balanced_psi(area, outlet), pressure, 1e-6);
  }
}

TEST(Volume, AirGivesWayMostAtLowPressure) {
  EXPECT_NEAR(air_capacity(0.08, 26), 1.08, 1e-12);
  EXPECT_GT(air_capacity(0.08, 1), 1.3);
  EXPECT_LT(air_capacity(0.08, 210), 1.01);
}

TEST(LiftTable, KeepsMonotonyAndItsNodes) {
  const LiftTable table(0, 4, {0, 1, 1, 5, 5.1});
  for (int k = 0; k <= 4; ++k)
    EXPECT_DOUBLE_EQ(table(k), (std::vector<double>{0, 1, 1, 5, 5.1})[static_cast<std::size_t>(k)]);
  for (double x = 0; x < 4; x += 0.01) EXPECT_LE(table(x), table(x + 0.01) + 1e-12);
  EXPECT_NEAR(table(table.lift_of(3)), 3, 1e-9);
}

}  // namespace
}  // namespace valvetriage::second_stand
