#pragma once

#include <limits>

namespace valvetriage::second_stand {

/// What is wrong with a valve or its stand, as excess over the healthy unit; every default is neutral.
/// Currents are input equivalents at 1.6 A.
struct Faults {
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  double breakaway_a = 0, kinetic_a = 0;
  double play_a = 0;
  double loop_a = 0;
  double blank_from_a = 0, blank_a = 0;  ///< a land without holes: where it begins, and how wide it is
  double stop_psi = kNever;              ///< an upper stop of the spool, as its steady pressure
  double ratio = 1;
  double curvature = 0;
  double gauge_delay_s = 0;
  double shorted_turn_s = 0;
  double mode_rad_s = 0, mode_damping = 0.5;
  double slew_a_per_s = kNever;
  double fall_to_rise = 1;
  double leak_fraction = 0;
  double exponent_added = 0;
  double spring_cubic = 0;  ///< cubic over linear force at the lift from 1.0 A to 2.0 A
  double hunting_psi = 0, hunting_hz = 0, hunting_level_psi = 0;
  double tone_psi = 0, tone_hz = 0;
  double warm_gain_change = 0, warm_time_s = 1;
  double offset_psi = 0, drift_psi_per_s = 0;
  double contact_gain_change = 0, contact_s = kNever;
  double psi_per_c = 0, psi_per_supply_psi = 0;

  // outside the vocabulary
  double silting = 0;                     ///< share of the port that silts up while the spool stands
  double jet_change = 0;                  ///< of the flow when the jet clings to the wall
  double pick_up_psi_s_per_a = 0;         ///< of the rate of the current in the gauge's cable
  double echo = 0, echo_s = 0;            ///< share of the pressure that comes back from the line's far end
  double turbulence_psi = 0;              ///< rms of the port's flow noise at 120 psi
  double slip_s = 0, slip_at_s = kNever;  ///< the pressure's buffer is late from an instant on
};

}  // namespace valvetriage::second_stand
