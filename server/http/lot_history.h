#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "server/store/store.h"

namespace valvetriage::http {

/// Limits of an individuals control chart: mean ± 3 σ, σ = mean moving range / 1.128 (Montgomery, Statistical Quality
/// Control, section 6.4).
struct ControlLimits {
  double centre = 0;
  double upper = 0;
  double lower = 0;
};

/// Nothing for fewer than two values. least: no lower limit below it, as an error has no sign.
std::optional<ControlLimits> control_limits(const std::vector<double>& values, double least);

/// One figure of a lot's valves, in the order the valves were received.
struct FigureHistory {
  std::vector<double> values;
  std::vector<std::size_t> valves;  ///< index into LotHistory::valves
  std::optional<ControlLimits> limits;
};

/// Settled causes of a valve, strongest first; none where its newest result has none.
std::vector<CauseSummary> settled_causes(const SubmissionRow& valve);

/// What a valve is counted under beside its verdict: each of its settled causes; without any its conclusion, empty
/// where nothing was looked for.
std::vector<std::string> outcomes(const SubmissionRow& valve);

/// q-values of a lot's names (core/classify/q_values.h): one list per valve, one value per settled cause.
std::vector<std::vector<double>> name_q_values(const std::vector<SubmissionRow>& valves);

/// Consecutive valves of one stand in which the same cause of origin `stand` is settled: the stand needs a look.
struct StandAlarm {
  std::string stand, cause;
  std::vector<std::size_t> valves;  ///< index of each, oldest first; two at least
  bool current = false;             ///< no valve without it came from this stand since
};

/// valves  each once, oldest first, of any stands
std::vector<StandAlarm> stand_alarms(const std::vector<SubmissionRow>& valves);

/// A lot over time: each valve once, by its newest submission with a result; a submission without serial is a valve.
struct LotHistory {
  std::vector<SubmissionRow> valves;              ///< oldest first
  std::map<double, FigureHistory> levels;         ///< Eq 20 error by current level [A]
  std::map<std::string, FigureHistory> features;  ///< of the frequency response, by name
};

/// Levels that lie within kLevelTolerance are one: they carry the value that most valves have, in `valves` as well.
///
/// submissions  of one lot, newest first
LotHistory lot_history(const std::vector<SubmissionRow>& submissions);

}  // namespace valvetriage::http
