#pragma once

#include <string>
#include <vector>

#include "core/discrepancy/linearised_valve.h"
#include "core/model/reference.h"

namespace valvetriage {

/// A change of the output that no cause stands for, and that is nowhere loud: spread over a whole session it is seen
/// only along its own signature.
struct UnnamedDirection {
  std::string name;                      ///< under which good valves' evidence is kept: LeftoverOnGoodValves
  std::string finding;                   ///< what it is, with its size
  LinearisedValve::Signature signature;  ///< of as much of it as is there
  double evidence = 0;  ///< what it takes off the cost beside what a fit can absorb, in noise variances as loud as they
                        ///< are; NaN where the recordings tell nothing of it
};

/// - A delay that grows through each recording: as between the clocks of two loggers.
/// - An output of which a part follows within seconds: as where a seal or a spring creeps.
///
/// Both go by the explanation's own free run y, about the middle of a recording: −ẏ·(t − t_mid), and y through a lag.
std::vector<UnnamedDirection> unnamed_directions(const LinearisedValve& fit);

/// Probability that one of n good valves shows as much along a direction, whose evidence is the square of a size:
/// square_p_value. `good` is of ln(1 + evidence).
double direction_p_value(double evidence, const LeftoverOnGoodValves& good, int valves);

}  // namespace valvetriage
