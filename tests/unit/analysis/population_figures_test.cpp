#include "core/analysis/population_figures.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/identify/valve_fit.h"

namespace valvetriage {
namespace {

constexpr double kReferencePsi = 200;

ValveParameters a_valve() {
  return {.spool = {.delay_s = 0.0071, .natural_frequency_rad_s = 230, .damping_ratio = 0.85},
          .loop_width_a = 0.004,
          .volume = {.time_constant_s = 0.066, .exponent = 0.53, .supply_psi = 310, .reference_psi = kReferencePsi},
          .narrow_loop_width_a = 0.0025};
}

UsualMechanisms usual() {
  return {.gauge_lag_s = 0.002, .loop_shares = {0, 0.4, 0.4, 0.2}};
}

Reference a_reference(const ValveParameters& mean) {
  Reference reference{.valve_type = "type-1", .valves = 8};
  const StaticMap map{.input = {1.0, 1.4, 1.8}, .output = {1, 20, 90}};
  reference.model = to_model(mean, map, usual());
  reference.map_sd = {0.1, 0.5, 1.5};
  const Eigen::VectorXd vector = to_vector(mean);
  for (std::size_t j = 0; j < kValveParameters.size(); ++j) {
    const ValveParameterInfo& info = kValveParameters[j];
    reference.parameters.push_back({std::string(info.name), std::string(info.unit), info.logarithmic ? "log" : "linear",
                                    vector(static_cast<Eigen::Index>(j)), 0.1});
  }
  reference.levels = {{.level_a = 1.4}, {.level_a = 1.75}};
  return reference;
}

TEST(PopulationFigures, AreTheParametersTheModelWasMadeOf) {
  const Reference reference = a_reference(a_valve());
  ValveParameters other = a_valve();
  other.spool.delay_s = 0.0079;
  other.narrow_loop_width_a = 0.001;
  const StaticMap map{.input = {1.0, 1.4, 1.8}, .output = {1, 24, 90}};
  const auto figures = population_figures(to_model(other, map, usual()), reference);
  const Eigen::VectorXd expected = to_vector(other);
  ASSERT_EQ(figures.size(), kValveParameters.size() + 2);
  for (std::size_t j = 0; j < kValveParameters.size(); ++j) {
    EXPECT_NEAR(figures[j].value, expected(static_cast<Eigen::Index>(j)), 1e-9) << figures[j].name;
    EXPECT_EQ(figures[j].logarithmic, kValveParameters[j].logarithmic);
    EXPECT_EQ(figures[j].good.valves, 8);
  }
  const PopulationFigure& at_knot = figures[kValveParameters.size()];
  EXPECT_EQ(at_knot.name, "steady_pressure_psi");
  EXPECT_EQ(at_knot.level_a, 1.4);
  EXPECT_NEAR(at_knot.value, 24, 1e-12);
  EXPECT_NEAR(at_knot.good.mean, 20, 1e-12);
  EXPECT_EQ(at_knot.good.sd, 0.5);
  EXPECT_EQ(figures.back().good.sd, 1.5) << "of the nearest knot";
}

TEST(PopulationFigures, AreNoneForAModelOfAnotherKind) {
  const Reference reference = a_reference(a_valve());
  EXPECT_TRUE(population_figures(Model{.kind = "linear"}, reference).empty());
  Reference older = reference;
  older.parameters.pop_back();
  EXPECT_TRUE(population_figures(reference.model, older).empty());
}

}  // namespace
}  // namespace valvetriage
