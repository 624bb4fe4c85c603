#pragma once

#include <optional>
#include <string>
#include <vector>

#include "server/store/store.h"

namespace valvetriage::http {

/// Limits of an individuals control chart: mean ± 3 σ, σ = mean moving range / 1.128 (Montgomery, Statistical Quality
/// Control, section 6.4). No lower limit below zero: an error has no sign.
struct ControlLimits {
  double centre = 0;
  double upper = 0;
  double lower = 0;
};

/// Nothing for fewer than two values.
std::optional<ControlLimits> control_limits(const std::vector<double>& values);

/// Eq 20 errors of a lot's valves at one current level, in the order the valves were received.
struct LevelHistory {
  double level_a = 0;
  std::vector<double> errors;
  std::vector<std::size_t> valves;  ///< index into LotHistory::valves
  std::optional<ControlLimits> limits;
};

/// A lot over time: each valve once, by its newest submission with a result; a submission without serial is a valve.
struct LotHistory {
  std::vector<SubmissionRow> valves;  ///< oldest first
  std::vector<LevelHistory> levels;   ///< by level
};

/// submissions  of one lot, newest first
LotHistory lot_history(const std::vector<SubmissionRow>& submissions);

}  // namespace valvetriage::http
