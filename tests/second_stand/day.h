#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tests/second_stand/random.h"

namespace valvetriage::second_stand {

/// A quantity that wanders about its mean as an Ornstein-Uhlenbeck process, on a grid of a tenth of a second.
class Wandering {
 public:
  Wandering(Random random, double mean, double rms, double memory_s);
  double at(double t_s) const;

 private:
  static constexpr double kGridS = 0.1;
  std::vector<double> value_;
};

/// What surrounds the valve while one recording is taken: a function of the day's seed and the recording's name.
struct Day {
  Day(std::uint64_t noise_seed, const std::string& recording, double supply_drift_psi);

  double supply_psi_at(double t_s) const;

  std::uint64_t past_seed;                     ///< currents before the recording, where the spool stuck
  double mean_temperature_c, mean_supply_psi;  ///< of the day; the gauge is zeroed at them
  Wandering temperature_c;
  Wandering supply_wander_psi;
  double supply_drift_psi;  ///< over a recording of 20 s, upstream of the regulator, which lets nothing of it through
  double tone_phase;
};

}  // namespace valvetriage::second_stand
