#include "server/http/lot_history.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

namespace valvetriage::http {
namespace {

constexpr double kRangeToSigma = 1.128;  // d2 of a moving range of two

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

}  // namespace

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
