#include "server/http/lot_history.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "core/classify/q_values.h"
#include "core/classify/rule_base.h"
#include "core/mechanisms/mechanism.h"

namespace valvetriage::http {
namespace {

constexpr double kRangeToSigma = 1.128;  // d2 of a moving range of two
// Two in a row: a stand cause is named at 0.95 or more, so that two names by chance are rarer than one in 400.
constexpr std::size_t kAlarmValves = 2;

std::vector<SubmissionRow> newest_by_valve(const std::vector<SubmissionRow>& submissions) {
  std::set<std::string> seen;
  std::vector<SubmissionRow> valves;
  for (const SubmissionRow& row : submissions) {
    if (row.state != JobState::kDone) continue;
    if (row.labels.serial && !seen.insert(*row.labels.serial).second) continue;
    valves.push_back(row);
  }
  std::reverse(valves.begin(), valves.end());
  return valves;
}

/// For each level that was measured the one it is shown as.
std::map<double, double> shown_levels(const std::vector<SubmissionRow>& valves) {
  std::map<double, int> counts;
  for (const SubmissionRow& valve : valves) {
    for (const LevelError& error : valve.summary.errors) ++counts[error.level_a];
  }
  std::map<double, double> shown;
  for (auto first = counts.begin(); first != counts.end();) {
    auto end = first, most = first;
    for (; end != counts.end() && end->first - first->first < kLevelTolerance; ++end) {
      if (end->second > most->second) most = end;
    }
    for (; first != end; ++first) shown[first->first] = most->first;
  }
  return shown;
}

bool is_stand_cause(const std::string& cause) {
  const Mechanism* law = find_mechanism(cause);
  return law != nullptr && law->origin == "stand";
}

}  // namespace

std::vector<CauseSummary> settled_causes(const SubmissionRow& valve) {
  std::vector<CauseSummary> settled;
  for (const CauseSummary& cause : valve.summary.causes) {
    if (cause.settled) settled.push_back(cause);
  }
  return settled;
}

std::vector<std::string> outcomes(const SubmissionRow& valve) {
  std::vector<std::string> names;
  for (const CauseSummary& cause : settled_causes(valve)) names.push_back(cause.cause);
  if (names.empty()) names.push_back(valve.summary.conclusion.value_or(""));
  return names;
}

std::vector<std::vector<double>> name_q_values(const std::vector<SubmissionRow>& valves) {
  std::vector<double> probabilities;
  for (const SubmissionRow& valve : valves) {
    for (const CauseSummary& cause : settled_causes(valve)) probabilities.push_back(cause.probability);
  }
  const std::vector<double> q = q_values(probabilities);
  std::vector<std::vector<double>> by_valve;
  auto next = q.begin();
  for (const SubmissionRow& valve : valves) {
    const auto end = next + static_cast<std::ptrdiff_t>(settled_causes(valve).size());
    by_valve.emplace_back(next, end);
    next = end;
  }
  return by_valve;
}

std::vector<StandAlarm> stand_alarms(const std::vector<SubmissionRow>& valves) {
  std::map<std::string, std::map<std::string, StandAlarm>> runs;  // those that go on, by stand and cause
  std::vector<StandAlarm> alarms;
  const auto end = [&](StandAlarm& run, bool current) {
    run.current = current;
    if (run.valves.size() >= kAlarmValves) alarms.push_back(std::move(run));
  };
  for (std::size_t i = 0; i < valves.size(); ++i) {
    if (!valves[i].labels.stand) continue;
    const std::string& stand = *valves[i].labels.stand;
    std::set<std::string> causes;
    for (const CauseSummary& cause : settled_causes(valves[i])) {
      if (is_stand_cause(cause.cause)) causes.insert(cause.cause);
    }
    std::map<std::string, StandAlarm> going_on;
    for (const std::string& cause : causes) {
      auto known = runs[stand].extract(cause);
      StandAlarm& run = going_on[cause];
      run = known ? std::move(known.mapped()) : StandAlarm{.stand = stand, .cause = cause, .valves = {}};
      run.valves.push_back(i);
    }
    for (auto& [cause, run] : runs[stand]) end(run, false);
    runs[stand] = std::move(going_on);
  }
  for (auto& [stand, of_stand] : runs) {
    for (auto& [cause, run] : of_stand) end(run, true);
  }
  std::stable_sort(alarms.begin(), alarms.end(),
                   [](const StandAlarm& a, const StandAlarm& b) { return a.valves.back() > b.valves.back(); });
  return alarms;
}

std::optional<ControlLimits> control_limits(const std::vector<double>& values, double least) {
  if (values.size() < 2) return std::nullopt;
  double sum = values.front(), ranges = 0;
  for (std::size_t i = 1; i < values.size(); ++i) {
    sum += values[i];
    ranges += std::abs(values[i] - values[i - 1]);
  }
  const double centre = sum / static_cast<double>(values.size());
  const double sigma = ranges / static_cast<double>(values.size() - 1) / kRangeToSigma;
  return ControlLimits{.centre = centre, .upper = centre + 3 * sigma, .lower = std::max(least, centre - 3 * sigma)};
}

LotHistory lot_history(const std::vector<SubmissionRow>& submissions) {
  LotHistory history{.valves = newest_by_valve(submissions), .levels = {}, .features = {}};
  const std::map<double, double> shown = shown_levels(history.valves);
  for (SubmissionRow& valve : history.valves) {
    for (LevelError& error : valve.summary.errors) error.level_a = shown.at(error.level_a);
  }
  const auto add = [](FigureHistory& figure, std::size_t valve, double value) {
    figure.values.push_back(value);
    figure.valves.push_back(valve);
  };
  for (std::size_t valve = 0; valve < history.valves.size(); ++valve) {
    const AnalysisSummary& summary = history.valves[valve].summary;
    for (const LevelError& error : summary.errors) add(history.levels[error.level_a], valve, error.error_eq20);
    for (const auto& [name, value] : summary.features) add(history.features[name], valve, value);
  }
  for (auto& [level_a, level] : history.levels) level.limits = control_limits(level.values, 0);
  for (auto& [name, feature] : history.features) {
    feature.limits = control_limits(feature.values, -std::numeric_limits<double>::infinity());
  }
  return history;
}

}  // namespace valvetriage::http
