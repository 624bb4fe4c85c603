#include "tests/stand/unit.h"

#include <algorithm>
#include <cmath>

#include "tests/stand/random.h"
#include "tests/stand/steady_map.h"

namespace valvetriage::stand {

Unit draw_unit(std::uint64_t seed) {
  Random random(seed, "unit");
  Unit unit;
  const auto spread = [&](double& value, double relative_sd) { value *= 1 + relative_sd * random.tolerance(); };
  spread(unit.delay_s, 0.10);
  spread(unit.driver_time_constant_s, 0.08);
  spread(unit.force_per_current_n_per_a, 0.01);
  spread(unit.magnetic_knee_a, 0.03);
  spread(unit.loop_width_a, 0.20);
  spread(unit.mass_kg, 0.04);
  spread(unit.spring_n_per_mm, 0.02);
  spread(unit.damping_ratio, 0.08);
  spread(unit.breakaway_a, 0.25);
  spread(unit.kinetic_ratio, 0.05);
  spread(unit.stribeck_mm_per_s, 0.15);
  spread(unit.outflow_exponent, 0.01);
  spread(unit.time_constant_120psi_s, 0.06);
  spread(unit.leak_fraction, 0.25);
  spread(unit.map_gain, 0.008);
  unit.map_shift_a = 0.003 * random.tolerance();
  for (double& bump : unit.map_bump_a) bump = 0.0015 * random.tolerance();
  spread(unit.sensor_time_constant_s, 0.06);
  unit.sensor_offset_psi = 0.15 * random.tolerance();
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
