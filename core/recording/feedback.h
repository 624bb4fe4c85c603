#pragma once

#include "core/recording/recording.h"

namespace valvetriage {

/// How far the changes of the input follow from the output: a controller's do, a drawn command's do not.
struct OutputFollowed {
  double of_all = 0;       ///< of the squares of the input's increments, by the present and two past outputs
  double beyond_past = 0;  ///< of those that the input's own past leaves; 0 where it leaves less than a millionth

  /// Above three quarters in both: nearly all in a regulated loop. A sweep or a ramp follows from its own past, and the
  /// output that answers it foretells it as well, the better the less noise there is; of what its past leaves it tells
  /// two thirds at most. A machine that answers at once tells the input by its present output alone, and no controller
  /// with integral action does.
  bool is_regulated() const { return of_all > kRegulated && beyond_past > kRegulated; }

 private:
  static constexpr double kRegulated = 0.75;
};

/// recording  of any length; the edges of commanded steps in its segments are left out, and samples that are not valid
/// Cost       O(n)
OutputFollowed output_followed(const Recording& recording);

}  // namespace valvetriage
