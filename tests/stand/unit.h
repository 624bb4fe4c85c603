#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace valvetriage::stand {

/// One valve as it left the line. The defaults are the nominal unit; `draw_unit` spreads every one of them.
struct Unit {
  // electrical and magnetic
  double delay_s = 0.004;  ///< driver and line, pure delay of the command
  double driver_time_constant_s = 0.004;
  double force_per_current_n_per_a = 20;
  double magnetic_knee_a = 3.5;  ///< F = K i_s tanh(i / i_s)
  double loop_width_a = 0.004;   ///< full width of the magnetic loop (Prandtl-Ishlinskii)
  // spool
  double mass_kg = 0.07;
  double spring_n_per_mm = 10;
  double damping_ratio = 0.75;
  double breakaway_a = 0.0010;  ///< friction in current equivalents at 1.6 A
  double kinetic_ratio = 0.75;  ///< Coulomb over breakaway
  double stribeck_mm_per_s = 0.5;
  // fluid
  double supply_psi = 300;
  double outflow_exponent = 0.55;
  double time_constant_120psi_s = 0.065;  ///< small-signal filling time at 120 psi, sets the compressibility
  double leak_fraction = 0.010;           ///< leak over through-flow at 210 psi
  double map_gain = 1, map_shift_a = 0;
  std::array<double, 6> map_bump_a{};  ///< local shifts of the map around 1.1, 1.3 ... 2.1 A
  // sensor
  double sensor_time_constant_s = 0.005;
  double sensor_offset_psi = 0;
};

/// How one parameter differs between healthy units: by `sd`, of its own value where it is `relative`.
struct UnitSpread {
  std::string name;
  double& (*of)(Unit&);
  double sd;
  bool relative;
};
/// Every parameter that differs between healthy units, in the order in which they are drawn (README, table).
const std::vector<UnitSpread>& unit_spread();

/// A healthy unit: the nominal one with every parameter spread (README, table of parameters). Pure function of the
/// seed.
Unit draw_unit(std::uint64_t seed);

/// Steady pressure [psi] of a unit at a coil current, on the middle of its loop.
double steady_pressure_psi(const Unit& unit, double current_a);
/// Magnetic force [N] at a current, its slope at 1.6 A [N/A], and the current of a force.
double magnetic_force_n(const Unit& unit, double current_a);
double force_slope_mid_n_per_a(const Unit& unit);
double current_of_force_a(const Unit& unit, double force_n);

}  // namespace valvetriage::stand
