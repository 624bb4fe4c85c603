#pragma once

#include <string>
#include <vector>

#include "tests/stand/command.h"
#include "tests/stand/environment.h"

namespace valvetriage::stand {

/// How a recording is taken: nothing here is a fault of the valve. Zero switches a condition off.
struct Conditions {
  double noise_psi = 0.35;         ///< rms of the pressure noise
  double noise_correlation_s = 0;  ///< of a first-order coloured noise; 0 is white
  double current_noise_a = 0.0005;
  double adc_psi = 0;            ///< quantum of the pressure channel; the current's is 1/250 of it in A
  double jitter_s = 0;           ///< rms of the instants of command and sample about the clock's; the stamps are true
  int dropped_rows = 0;          ///< rows lost, in bursts of 5
  double ripple_a = 0;           ///< PWM ripple at the driver
  double dither_a = 0;           ///< dither on the command
  double setpoint_wander_a = 0;  ///< the operator's set-point moves; the log shows it
};

/// A healthy peculiarity of a recording that must not be mistaken for a fault.
struct DecoyInfo {
  std::string decoy, size_meaning;
  double usual_size;
};
const std::vector<DecoyInfo>& decoy_table();

/// Switches a decoy on; size 0 means its usual size. Throws std::invalid_argument for an unknown name.
void apply_decoy(const std::string& decoy, double size, Conditions& conditions);

/// The command as played under these conditions: with dither, a wandering set-point and a jittering clock.
Command as_played(const Command& command, const Conditions& conditions, std::uint64_t noise_seed);

/// One recording; columns in the contract's units.
struct StandRecording {
  std::string name, test;
  std::vector<double> time_s, current_a, pressure_psi, temperature_c, supply_psi;
  std::vector<double> command_a, clean_psi;  ///< without noise, for the scorer only
};

/// Sampling instants of a command, from 0 on.
std::vector<double> sample_times_s(const Command& command);

/// Puts noise, ripple, quantisation and drop-outs on the noise-free pressure taken at `times_s`.
StandRecording log_recording(const Command& command, const Conditions& conditions, const Environment& environment,
                             std::uint64_t noise_seed, std::vector<double> times_s, std::vector<double> clean_psi);

}  // namespace valvetriage::stand
