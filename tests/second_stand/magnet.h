#pragma once

#include "tests/second_stand/unit.h"

namespace valvetriage::second_stand {

/// Force of the coil at an effective current, at no lift.
inline double coil_force_n(const Unit& unit, double effective_a) {
  const double ratio = effective_a / unit.saturation_a;
  return unit.force_n_per_a2 * effective_a * effective_a / (1 + ratio * ratio);
}

/// Its slope at 1.6 A: one ampere of a force "in current equivalents".
inline double force_of_ampere_n(const Unit& unit) {
  const double ratio = 1.6 / unit.saturation_a, knee = 1 + ratio * ratio;
  return 2 * unit.force_n_per_a2 * 1.6 / (knee * knee);
}

/// Lift at which coil and spring are in balance: F (1 - λ x) = preload + k x.
inline double balanced_lift_mm(const Unit& unit, double effective_a) {
  const double force_n = coil_force_n(unit, effective_a);
  return (force_n - unit.preload_n) / (unit.spring_n_per_mm + unit.stroke_loss_per_mm * force_n);
}

}  // namespace valvetriage::second_stand
