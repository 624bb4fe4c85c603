#pragma once

#include <algorithm>
#include <span>

#include "core/model/valve_dynamics.h"

namespace valvetriage {

/// How a force or a way of the spool, told in amperes, grows along the input, over its value in the middle.
struct GrowthAlongInput {
  double per_a = 0;     ///< [1/A]
  double middle_a = 0;  ///< of the range of inputs [A]

  bool operator==(const GrowthAlongInput&) const = default;
  /// At x, over the value in the middle; never less than a twentieth, to one side of any range.
  double share_at(double x) const { return std::max(1 + per_a * (x - middle_a), 0.05); }
};

/// Dry friction on the spool, in input equivalents of the force:
///
///   ẍ = ωn² (u − x − f) − 2 ζ ωn ẋ,   |f| ≤ F_s at rest,   f = sign(ẋ) (F_k + (F_s − F_k) e^(−(ẋ/v_s)²)) in motion
///
/// with F_s and F_k growing by the way of the spool, both times 1 + growth (x − middle): one force takes more current
/// where the magnet saturates, less where its force grows with the square of the current, and lands rub unevenly.
///
/// Source: Stribeck's curve as in Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083; the force that
/// would stop the motion, clamped to the friction force, implicitly: Karnopp, J. Dyn. Sys. Meas. Control 107 (1985)
/// 100.
struct SpoolFriction {
  double breakaway_a = 0;       ///< F_s ≥ 0; 0: none [A]
  double kinetic_a = 0;         ///< F_k, at most F_s [A]
  double stribeck_a_per_s = 0;  ///< v_s > 0, speed in input equivalents [A/s]
  GrowthAlongInput growth;      ///< of both forces

  bool operator==(const SpoolFriction&) const = default;
};

/// The equal steps that a sample is integrated in.
int sliding_substeps(const ValveDynamics& dynamics, double sample_period_s);

/// Spool positions with friction, one per sample; the input delayed and lagged before it as the dynamics are (one lag
/// at most).
///
/// offset  where the spool rests before the first sample: at input − offset · F_s, −1 ≤ offset ≤ 1
/// rests   empty, or where the spool is known to rest at each sample, NaN where it is not known to [A]: a spool that
/// has
///         slipped begins its next slip there. Each slip is then predicted from where the last one really ended, and an
///         error of one does not move all that follow (as in multiple shooting: Bock, Numerical Treatment of Inverse
///         Problems in Differential Equations (1983) 95)
/// Cost    O(n · substeps), trapezoidal steps of at most a seventh of 1/ωn, one more where the input jumps, none while
///         the spool sticks: behind a lag, under an input that holds
void run_sliding_spool(const ValveDynamics& dynamics, const SpoolFriction& friction, double sample_period_s,
                       const IntervalSignal& input, double offset, std::span<double> position,
                       std::span<const double> rests = {});

/// One of several spools to be run. What it points to outlives the run.
struct SlidingRun {
  const ValveDynamics* dynamics = nullptr;
  const SpoolFriction* friction = nullptr;
  double sample_period_s = 0;
  const IntervalSignal* input = nullptr;
  double offset = 0;
  std::span<double> position;
  std::span<const double> rests;
};

/// The same for several spools or recordings, bit for bit, in less time.
void run_sliding_spools(std::span<const SlidingRun> runs);

}  // namespace valvetriage
