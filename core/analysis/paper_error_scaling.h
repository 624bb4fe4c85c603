#pragma once

namespace valvetriage {

/// By what Eq 20 is multiplied when its rate, or its duration, is doubled: for a residual that goes on (a tone) and for
/// one that dies out (a settling error of 0.1 s). No one factor converts both.
struct ErrorScaling {
  double stationary_by_rate = 0;      ///< √2
  double stationary_by_duration = 0;  ///< 1/√2
  double transient_by_rate = 0;       ///< √2
  double transient_by_duration = 0;   ///< 1/2
};
ErrorScaling measure_error_scaling();

}  // namespace valvetriage
