#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/second_stand/command.h"
#include "tests/second_stand/day.h"

namespace valvetriage::second_stand {

/// How a recording is taken; nothing here is a fault. Zero switches a decoy off.
struct Conditions {
  double noise_psi = 0.33;  ///< rms of all noise of the pressure but tails and pick-up
  double current_noise_a = 0.0004;
  double colour_s = 0;          ///< correlation of the noise's broad part
  double spike_share = 0;       ///< share of samples with ten times the noise
  double adc_psi = 0;           ///< quantum of the pressure; of the current 1/250 of it in A
  double jitter_s = 0;          ///< rms of the instants of command and sample; the stamps are true
  int lost_rows = 0;            ///< per recording, in bursts
  double ripple_a = 0;          ///< PWM ripple of the driver, a twelfth of it seen by the monitor
  double dither_a = 0;          ///< dither on the command
  double supply_drift_psi = 0;  ///< over 20 s, upstream of the regulator, logged
};

struct Decoy {
  std::string name;
  double usual_size;
  std::string size_meaning;
  void (*apply)(double size, Conditions&);
};
const std::vector<Decoy>& decoys();

/// Throws std::invalid_argument for an unknown name; size 0 is the usual one.
void apply_decoy(const std::string& name, double size, Conditions& conditions);

/// One recording; columns in the contract's units, and what only the scorer may see.
struct Log {
  std::string name, test;
  std::vector<double> time_s, current_a, pressure_psi, temperature_c, supply_psi;
  std::vector<double> clean_psi, command_a;
};

/// The command with the instants at which it is played and sampled.
Command as_clocked(const Command& command, const Conditions& conditions, std::uint64_t noise_seed);

Log log_of(const Command& command, const Conditions& conditions, const Day& day, std::uint64_t noise_seed,
           std::vector<double> clean_psi);

}  // namespace valvetriage::second_stand
