#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "tests/stand/random.h"

namespace valvetriage::stand {

/// A slowly wandering quantity: a few incommensurate sines of random phase.
class Wander {
 public:
  Wander(Random random, double mean, double amplitude, double fastest_hz);
  double at(double t_s) const;

 private:
  struct Wave {
    double amplitude = 0, rad_s = 0, phase = 0;
  };
  double mean_;
  std::array<Wave, 3> wave_;
};

/// What surrounds the unit while one recording is taken. A pure function of the day's seed and the recording's name.
struct Environment {
  Environment(std::uint64_t noise_seed, const std::string& recording);

  /// 0 or 1, switching at random (exponential dwell of 1 s mean).
  double telegraph(double t_s) const;

  std::uint64_t history_seed;
  double day_temperature_c, day_supply_psi;  ///< means of the day; the gauge is zeroed at them
  Wander temperature_c;                      ///< fluid
  Wander supply_psi;  ///< upstream of the stand's regulator; a good stand does not let it through to the valve
  double tone_phase;
  std::vector<double> telegraph_s;  ///< switching instants
};

}  // namespace valvetriage::stand
