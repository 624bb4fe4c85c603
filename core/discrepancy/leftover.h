#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/discrepancy/discrepancy.h"
#include "core/discrepancy/linearised_valve.h"
#include "core/discrepancy/valve_diagnosis.h"
#include "core/discrepancy/valve_explanation.h"

namespace valvetriage {

/// How slow a residual is, by groups of like samples: input at rest or moving, by thirds of the output's range.
///
/// Values: ln(mean square of block means over what the same samples' own fast noise would give), less the same of the
/// group at rest at the lowest level. Noise that is coloured everywhere, louder where the output moves (a jittering
/// clock) or coarse takes no part in it; what depends on the input does. NaN for a group with too few blocks.
///
/// The last group holds rest against rest: ln(mean square of a rest's mean over what slow noise, which moves within a
/// rest too, makes of it). A reading that sticks holds another level at every rest; its blocks are the rests.
struct LeftoverGroup {
  std::string group;
  double log_ratio = 0;
  double own_log_ratio = 0;  ///< before that of the lowest level at rest is taken off: 0 in white noise
  double mean_square = 0;    ///< in noise variances
  int blocks = 0;
};
///
/// residual      whitened, at the rows of `fit`
/// output_range  [psi]
std::vector<LeftoverGroup> leftover_groups(const LinearisedValve& fit, const Stack& residual, double output_range);

/// How far a group is from good valves, in standard deviations, and the probability that a good valve is as slow.
struct Unusual {
  double statistic = 0, p_value = 1;
};

/// Whether a group of `blocks` blocks is slower than n good valves': as ln of a mean of squares, which scatters by
/// √(2 / blocks) in itself, and, whichever is less rare, as what is slow beyond noise. This is the square of an
/// amplitude, of what a simulation gets wrong in one valve: where most good valves happen to lie near none, others are
/// several times as far out (square_p_value).
Unusual slower_than_good_valves(double log_ratio, int blocks, const LeftoverOnGoodValves& good, int valves);

/// What is left in a good valve, by group and by unnamed direction, and in all above its noise, as a reference keeps
/// it: LeftoverOnGoodValves. `linear`: around `explanation`.
std::vector<std::pair<std::string, double>> leftovers_of_good_valve(const LinearisedValve& linear,
                                                                    const Explanation& explanation);

/// What is left beside an explanation, against good valves.
struct Leftover {
  double p_value = 1;             ///< in a good valve, over all groups of samples and all unnamed directions
  double at_rest = 0;             ///< mean square at rest, at its loudest level, in noise variances
  double at_rest_deviations = 0;  ///< of the slowness at rest at the lowest level from that of good valves
  double slow_at_rest = 0;        ///< mean square of what is slow there, less good valves', in that of the fast noise
  std::vector<Finding> findings;
};
Leftover leftover_of(const LinearisedValve& linear, const ValveDiagnosisOptions& options);

/// What noise alone costs in this session.
double noise_cost(const Explanation& explanation);

/// Slow noise of so many times the power of the fast noise, three times it in the rms altogether, is no noise: a gauge
/// that sticks shows another level at every rest.
inline constexpr double kMostSlowNoise = 10;

/// That an explanation leaves more than kMostSlowNoise above the noise, and more than good valves leave: where
/// recordings never rest, no group of samples tells slow noise from what is wrong. None where the reference does not
/// know what good valves leave.
std::optional<Finding> far_above_noise(const Explanation& explanation, double samples,
                                       const ValveDiagnosisOptions& options);

/// What a good valve would cost beyond the noise in a session whose noise costs `noise`: the mean of those the
/// reference holds; 0 where it tells nothing of it.
double usual_above_noise(double noise, const ValveDiagnosisOptions& options);

}  // namespace valvetriage
