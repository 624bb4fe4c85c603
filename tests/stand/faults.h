#pragma once

#include <limits>

namespace valvetriage::stand {

/// What is wrong with a unit or its stand, in physical numbers; every default is neutral. All are excesses over the
/// healthy unit. Currents are input equivalents at 1.6 A. Order: as in the contract's table of causes.
struct Faults {
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  double breakaway_a = 0, kinetic_a = 0;
  double backlash_a = 0;
  double loop_a = 0;
  double dead_centre_a = 0, dead_width_a = 0;
  double ceiling_psi = kNever;
  double pressure_ratio = 1;
  double curvature = 0;
  bool rectified = false;
  double delay_s = 0;
  double extra_lag_s = 0;
  double mode_period_s = 0, mode_damping = 1;
  double slew_a_per_s = kNever;
  double fall_to_rise = 1;
  double leak_fraction = 0;
  double exponent_loss = 0;
  double spring_cubic = 0;  ///< cubic over linear part of the spring force at full travel
  double hunting_psi = 0, hunting_hz = 0, hunting_level_psi = 0;
  double tone_psi = 0, tone_hz = 0;
  double warming_gain_change = 0, warming_time_constant_s = 1;
  double offset_psi = 0, drift_psi_per_s = 0;
  double contact_gain_change = 0, contact_s = kNever;
  double psi_per_c = 0, psi_per_supply_psi = 0;

  // outside the vocabulary
  double telegraph_gain = 0;
  double surge_share = 0;     ///< supply lost while the stand's accumulator is empty
  double entrained_air = 0;   ///< compressibility of the air at 26 psi over that of the fluid
  double clock_error = 0;     ///< the pressure's clock runs slow by this ratio
  double tube_stick_psi = 0;  ///< the gauge's tube holds until the pressure differs by this
  double creep = 0;           ///< share of the current's effect that comes late, over three decades of time
};

}  // namespace valvetriage::stand
