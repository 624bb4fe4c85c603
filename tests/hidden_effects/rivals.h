#pragma once

#include <span>
#include <string>
#include <vector>

#include "tests/stand/effects.h"

namespace valvetriage::hidden_effects {

/// One number of a rival's law, searched in the coordinate of its scale.
struct Axis {
  double low, high;
  bool logarithmic;
  std::vector<double> starts;  ///< values of the screening grid

  double coordinate(double value) const;
  double value(double coordinate) const;  ///< held inside [low, high]
};

/// A cause as the stand makes it, with every number of its law free: what the true cause is measured against. The first
/// axis is the size.
struct Rival {
  std::string cause;
  std::vector<Axis> axes;
  void (*apply)(std::span<const double> values, const stand::Unit& unit, stand::Faults& faults);
};

/// The causes that act inside the valve and need a simulation. The others (offset, drift, tone, contact, side channel)
/// add a known shape to the output and are fitted in closed form (distances.cpp).
const std::vector<Rival>& simulated_rivals();

}  // namespace valvetriage::hidden_effects
