#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// One dependence of the residual.
struct Finding {
  std::string what;   ///< "depends on the sign of the input's change"
  std::string where;  ///< segment, level, band or recording
  double statistic = 0;
  double p_value = 1;
  double share_of_structured_residual = 0;
};

/// One recording with what a simulation leaves of it.
struct ResidualView {
  const Recording* recording = nullptr;
  std::span<const double> residual;  ///< measured − simulated, one per grid sample
  double noise_floor = 0;            ///< rms of its irreducible noise, unit of the output
};

struct FindingOptions {
  double significance = 0.01;  ///< chance of any finding at all where the residual is noise
};

/// What the residual depends on: the input's level, the sign of its last change, the simulated output and its rate,
/// the time since a step, the time in the recording, single frequencies, side channels; where it is larger than
/// elsewhere (recording, segment); and whether its local variance depends on the level.
///
/// Each dependence is a regression of the residual on bins or on one regressor, both sides freed of
/// the level's bins first (of the recording's, for time and channels). Its t is clustered: scores are summed over
/// blocks far longer than the residual's correlation, the variance of a sum is that of the blocks with one lag of
/// Bartlett's weight (Newey and West, Econometrica 55 (1987) 703), and the degrees of freedom are those of the blocks
/// that carry the regressor (Satterthwaite). So a p-value holds under coloured noise, without a model of it that a
/// misfit could spoil; the price is power, which a misfit worth showing has. Bins are paid for by Bonferroni inside a
/// dependence, the dependences by Bonferroni among each other. A line's p-value compares it with its neighbours in the
/// periodogram.
///
///   share  the mean square that the dependence explains over the mean square above the noise floors. Dependences
///          overlap, so shares need not sum to 1; NaN for the local variance, which is no part of the mean
///
/// returns  the significant ones, largest share first
/// Cost     O(n log n) for n samples in all
std::vector<Finding> find_dependences(std::span<const ResidualView> recordings, const FindingOptions& options = {});

}  // namespace valvetriage
