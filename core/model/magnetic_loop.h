#pragma once

#include <array>
#include <span>
#include <vector>

#include "core/recording/intersample.h"

namespace valvetriage {

/// Rate-independent loop between coil current and magnetic force, smooth and of Prandtl-Ishlinskii form:
///
///   x = u − (width/2) Σ_k share_k E_k / r_k,   E_k ← clamp(E_k + Δu, −r_k, r_k)
///
/// Four stop operators E_k with thresholds r_k spread over two decades of reversal, the first for dry friction; on a
/// long way one way every E_k sits at its bound and the loop is `width` wide. How the width is shared among them is the
/// loop's shape, a property of the material and the build. Source: Kuhnen, Eur. J. Control 9 (2003) 407; good valves
/// have one too.
///
/// The memory is driven by the input without its noise: noise on a hold would walk through it and demagnetise it. The
/// driver follows the input only when it leaves a band of one standard deviation of what noise is left in it.
struct MagneticLoop {
  static constexpr std::array<double, 4> kThresholds_a{0.003, 0.03, 0.1, 0.3};
  using Shares = std::array<double, kThresholds_a.size()>;
  static constexpr Shares kEqualShares{0.25, 0.25, 0.25, 0.25};

  double width_a = 0;            ///< full width after reach · 0.6 A one way, ≥ 0 [A]
  double memory = 0;             ///< state before the first sample: E_k = memory · r_k, −1 ≤ memory ≤ 1
  Shares shares = kEqualShares;  ///< of the width, ≥ 0, their sum is 1
  double reach = 1;              ///< r_k = reach · kThresholds_a, > 0; less than 1 for a valve of small currents

  /// r_k [A]
  std::array<double, kThresholds_a.size()> thresholds_a() const {
    std::array<double, kThresholds_a.size()> thresholds = kThresholds_a;
    for (double& threshold : thresholds) threshold *= reach;
    return thresholds;
  }

  /// The force's input equivalent x between samples, steps held where the input is held.
  IntervalSignal apply(const IntervalSignal& input, std::span<const double> driver) const;
};

/// The input as the loop's memory sees it, one value per sample: noise gated, edges kept. Cost O(n)
///
/// gate  half of the band that the driver does not leave; `loop_gate` of the same input, or of the one it was made from
std::vector<double> loop_driver(const IntervalSignal& input, double gate);
double loop_gate(const IntervalSignal& input);

}  // namespace valvetriage
