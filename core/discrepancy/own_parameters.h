#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/discrepancy/valve_diagnosis.h"

namespace valvetriage {

/// How the parameters and the map that a valve was fitted with lie among those of good valves. A fit can take a fault
/// up in them and leave nothing: a lag as a slower volume, a loss of gain as a lower map.
struct OwnParameters {
  double p_value = 1;             ///< in a good valve, over all parameters and knots (Bonferroni, by how many
                                  ///< of them are independent)
  std::vector<Finding> findings;  ///< the farthest first: one per parameter that a good valve in a hundred has not,
                                  ///< and one for the map
};

/// v       of a ValveFitProblem
/// errors  of its entries by the noise of the recordings
///
/// Each deviation from the mean over good valves' spread, the uncertainty of their mean and the error included, is a
/// Student t of n − 1 freedoms for n good valves. The fit is drawn to their mean, so what it shows is less than what is
/// there.
OwnParameters own_parameters_of(const Eigen::VectorXd& v, const Eigen::VectorXd& errors,
                                const ValveDiagnosisOptions& options);

}  // namespace valvetriage
