#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/recording/intersample.h"

namespace valvetriage {

/// Rate-independent loop between coil current and magnetic force, smooth and of Prandtl-Ishlinskii form:
///
///   x = u − (width/2) mean_k(E_k / r_k),   E_k ← clamp(E_k + Δu, −r_k, r_k)
///
/// Four stop operators E_k with thresholds r_k spread over two decades of reversal; on a long way one way every E_k
/// sits at its bound and the loop is `width` wide. Source: Kuhnen, Eur. J. Control 9 (2003) 407; good valves have one
/// too.
///
/// The memory is driven by the input without its noise: noise on a hold would walk through it and demagnetise it. The
/// driver follows the input only when it leaves a band of three noise standard deviations.
struct MagneticLoop {
  static constexpr std::array<double, 4> kThresholds_a{0.004, 0.015, 0.06, 0.2};

  double width_a = 0;  ///< full width of the major loop at mid range, ≥ 0 [A]
  double memory = 0;   ///< state before the first sample: E_k = memory · r_k, −1 ≤ memory ≤ 1

  /// The force's input equivalent x between samples, steps held where the input is held.
  IntervalSignal apply(const IntervalSignal& input, std::span<const double> driver) const;
};

/// The input as the loop's memory sees it, one value per sample: noise gated, edges kept. Cost O(n)
std::vector<double> loop_driver(const IntervalSignal& input);

}  // namespace valvetriage
