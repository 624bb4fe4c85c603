#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "core/discrepancy/linearised_valve.h"
#include "core/model/reference.h"

namespace valvetriage {

/// How many times more a residual's slow part varies than white noise of the stated variance would: the largest, over
/// block lengths of 1 to 64 samples, of the variance of block sums over the block length. At least 1.
///
/// Both a coloured noise and a simulation's own bias make evidence look stronger than it is by this factor.
double noise_inflation(const Stack& whitened_residual);

/// Probability that a good valve seems to have as much of a cause.
///
///   s² = 1 + max(0, (mean over good valves − kNoise) / k),  F = (reduction − (kNoise − k)) / (k s²)
///
/// Noise is known, the spread between valves only from n of them: F's second freedom is n (s² / (s² − 1))²,
/// Satterthwaite 1946. `kNoise` is what noise alone gives after the search over the law's instants or frequencies, k
/// the parameters.
///
/// reduction  of the cost, over the noise's inflation
double good_valve_p_value(double reduction, Eigen::Index freedoms, double noise_reduction, double good_valve_mean,
                          int good_valves);

/// The same by the size of the effect, where good valves have a mean size: Student's t of
/// (size − mean) / √(sd² (1 + 1/n) + error²), the error of the size known, sd from n valves.
///
/// size_from_none  the size less that of no effect
/// mean_from_none  the same of good valves' mean
double size_p_value(double size_from_none, double mean_from_none, double sd, double reduction, int good_valves);

/// How slow a residual is, by groups of like samples: input at rest or moving, by thirds of the output's range.
///
/// Values: ln(mean square of block means over what the same samples' own fast noise would give), less the same of the
/// group at rest at the lowest level. Noise that is coloured everywhere, louder where the output moves (a jittering
/// clock) or coarse takes no part in it; what depends on the input does. NaN for a group with too few blocks.
struct LeftoverGroup {
  std::string group;
  double log_ratio = 0;
  int blocks = 0;
};
std::vector<LeftoverGroup> leftover_groups(const LinearisedValve& fit, double output_range);

}  // namespace valvetriage
