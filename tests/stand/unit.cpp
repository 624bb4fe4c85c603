#include "tests/stand/unit.h"

#include <algorithm>
#include <cmath>

#include "tests/stand/random.h"
#include "tests/stand/steady_map.h"

namespace valvetriage::stand {

const std::vector<UnitSpread>& unit_spread() {
  static const std::vector<UnitSpread> table = {
      {"delay_s", [](Unit& u) -> double& { return u.delay_s; }, 0.10, true},
      {"driver_time_constant_s", [](Unit& u) -> double& { return u.driver_time_constant_s; }, 0.08, true},
      {"force_per_current_n_per_a", [](Unit& u) -> double& { return u.force_per_current_n_per_a; }, 0.01, true},
      {"magnetic_knee_a", [](Unit& u) -> double& { return u.magnetic_knee_a; }, 0.03, true},
      {"loop_width_a", [](Unit& u) -> double& { return u.loop_width_a; }, 0.20, true},
      {"mass_kg", [](Unit& u) -> double& { return u.mass_kg; }, 0.04, true},
      {"spring_n_per_mm", [](Unit& u) -> double& { return u.spring_n_per_mm; }, 0.02, true},
      {"damping_ratio", [](Unit& u) -> double& { return u.damping_ratio; }, 0.08, true},
      {"breakaway_a", [](Unit& u) -> double& { return u.breakaway_a; }, 0.25, true},
      {"kinetic_ratio", [](Unit& u) -> double& { return u.kinetic_ratio; }, 0.05, true},
      {"stribeck_mm_per_s", [](Unit& u) -> double& { return u.stribeck_mm_per_s; }, 0.15, true},
      {"outflow_exponent", [](Unit& u) -> double& { return u.outflow_exponent; }, 0.01, true},
      {"time_constant_120psi_s", [](Unit& u) -> double& { return u.time_constant_120psi_s; }, 0.06, true},
      {"leak_fraction", [](Unit& u) -> double& { return u.leak_fraction; }, 0.25, true},
      {"map_gain", [](Unit& u) -> double& { return u.map_gain; }, 0.008, true},
      {"map_shift_a", [](Unit& u) -> double& { return u.map_shift_a; }, 0.003, false},
      {"map_bump_a[0]", [](Unit& u) -> double& { return u.map_bump_a[0]; }, 0.0015, false},
      {"map_bump_a[1]", [](Unit& u) -> double& { return u.map_bump_a[1]; }, 0.0015, false},
      {"map_bump_a[2]", [](Unit& u) -> double& { return u.map_bump_a[2]; }, 0.0015, false},
      {"map_bump_a[3]", [](Unit& u) -> double& { return u.map_bump_a[3]; }, 0.0015, false},
      {"map_bump_a[4]", [](Unit& u) -> double& { return u.map_bump_a[4]; }, 0.0015, false},
      {"map_bump_a[5]", [](Unit& u) -> double& { return u.map_bump_a[5]; }, 0.0015, false},
      {"sensor_time_constant_s", [](Unit& u) -> double& { return u.sensor_time_constant_s; }, 0.06, true},
      {"sensor_offset_psi", [](Unit& u) -> double& { return u.sensor_offset_psi; }, 0.15, false},
  };
  return table;
}

Unit draw_unit(std::uint64_t seed) {
  Random random(seed, "unit");
  Unit unit;
  for (const UnitSpread& spread : unit_spread()) {
    double& value = spread.of(unit);
    value = spread.relative ? value * (1 + spread.sd * random.tolerance()) : spread.sd * random.tolerance();
  }
  return unit;
}

double steady_pressure_psi(const Unit& unit, double current_a) {
  double shifted = current_a + unit.map_shift_a;
  double centre = 1.1;
  for (const double bump : unit.map_bump_a) {
    const double z = (current_a - centre) / 0.12;
    shifted += bump * std::exp(-0.5 * z * z);
    centre += 0.2;
  }
  return std::max(0.05, unit.map_gain * nominal_steady_pressure_psi()(shifted));
}

double magnetic_force_n(const Unit& unit, double current_a) {
  return unit.force_per_current_n_per_a * unit.magnetic_knee_a * std::tanh(current_a / unit.magnetic_knee_a);
}

double force_slope_mid_n_per_a(const Unit& unit) {
  const double ratio = std::tanh(1.6 / unit.magnetic_knee_a);
  return unit.force_per_current_n_per_a * (1 - ratio * ratio);
}

double current_of_force_a(const Unit& unit, double force_n) {
  return unit.magnetic_knee_a * std::atanh(force_n / (unit.force_per_current_n_per_a * unit.magnetic_knee_a));
}

}  // namespace valvetriage::stand
