#pragma once

#include <span>
#include <vector>

#include "core/identify/valve_fit.h"

namespace valvetriage {

/// Where a spool that sticks and slips rests, told by its pressure: the steady pressure behind the volume's lag, as
/// long as it stands still by its noise, through the map backwards.
///
/// valve, map   as far as they are known
/// gauge_lag_s  of the gauge, ≥ 0
/// noise_psi    standard deviation of the noise, > 0
/// Returns      the same position at every sample of one rest, NaN where the spool moves, where samples are missing and
///              where the map is too flat to tell [A]
/// Cost         O(n)
std::vector<double> spool_rests(const Recording& recording, const ValveParameters& valve, const StaticMap& map,
                                double gauge_lag_s, double noise_psi);

/// One slip of a spool from rest to rest under an input that hardly moves meanwhile, as on a slow ramp.
struct Slip {
  int direction = 0;    ///< of the spool, −1 or 1
  double before_a = 0;  ///< input less position when it set off: the breakaway force, with the slip's sign [A]
  double after_a = 0;   ///< when it came to rest: the kinetic force where the spool is well damped [A]
};

/// The slips between rests, in order.
///
/// input  at each sample, behind the magnetic loop [A]
/// rests  as spool_rests gives them
std::vector<Slip> slips_between(std::span<const double> input, std::span<const double> rests);

}  // namespace valvetriage
