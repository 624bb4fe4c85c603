#pragma once

#include <span>
#include <vector>

#include "core/result.h"

namespace valvetriage {

/// A monotone static characteristic, input to steady output: piecewise linear through (input[i], output[i]), held flat
/// slope beyond its ends (linear extension by the end slopes is never used for a verdict: levels outside are reported).
///
/// input   n ≥ 2 knots, strictly increasing, unit of the input; for valves 0.025 A apart or finer
/// output  n values, non-decreasing (or all non-increasing), unit of the output
struct StaticMap {
  std::vector<double> input;
  std::vector<double> output;

  /// Steady output at an input; beyond the ends the end value's tangent of the last piece.
  double operator()(double u) const;
  /// In place on a signal; quick where neighbours lie on one piece, as those of a recording do.
  void apply(std::span<double> signal) const;
  /// Slope at an input, unit of output per unit of input.
  double slope(double u) const;
  /// The input that gives an output, the smallest one where the map is flat. Errors: outside the map's range.
  Result<double> inverse(double y) const;
};

/// Nearest monotone sequence in weighted least squares (pool adjacent violators).
std::vector<double> monotone_regression(std::span<const double> values, std::span<const double> weights);

}  // namespace valvetriage
