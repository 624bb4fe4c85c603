#pragma once

#include <vector>

#include "core/mechanisms/mechanism.h"

namespace valvetriage {

/// `count` values from `low` to `high`, each the same ratio above the one before; both positive. Empty where the range
/// is.
std::vector<double> spread(double low, double high, int count);

/// Bounds of a law with one parameter, a start at each of `starts` (those outside the bounds are left out).
MechanismBounds one_parameter(double lower, double upper, double step, const std::vector<double>& starts);

/// A value of each sign for each size.
std::vector<double> both_signs(const std::vector<double>& sizes);

/// Width of the input's range.
inline double input_range(const MechanismScales& scales) {
  return scales.input_high - scales.input_low;
}

/// Of a force or a way of the spool along the input, told in amperes: at most 2.3 times as much at one end of the range
/// as at the other. A magnet's force per ampere falls by a third where its iron saturates, and doubles over a range
/// from i to 2 i where it grows with the square.
inline double most_growth(double range) {
  return 0.8 / range;
}

}  // namespace valvetriage
