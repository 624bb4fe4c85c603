#pragma once

#include <string>
#include <vector>

#include "core/classify/rivals/possibilistic_c_means.h"
#include "server/report/valve_residuals.h"

namespace valvetriage::http {

using report::ValveResiduals;

/// What the members of a group leave of one test [unit of the output].
struct GroupResidual {
  std::string test;            ///< key of the residuals
  std::vector<double> time_s;  ///< middles of the runs
  std::vector<double> mean, sd;
  std::vector<double> good;  ///< what good valves leave on the average; empty without any
};

struct LotPattern {
  std::vector<std::size_t> members;  ///< index of the valve, most typical first
  std::vector<double> typicality;
  std::vector<GroupResidual> residuals;  ///< of the tests that at least two members have
};

/// Groups the valves whose residuals look alike: directions of their residuals beyond what good valves leave
/// (residual_directions), clustered by possibilistic c-means (possibilistic_groups) with typicality 1/2 at a
/// correlation of 0.75 with the group's mean.
///
/// valves  unexplained ones; good  valves of the same lot in which nothing is wrong, any number
std::vector<LotPattern> lot_patterns(const std::vector<ValveResiduals>& valves,
                                     const std::vector<ValveResiduals>& good);

}  // namespace valvetriage::http
