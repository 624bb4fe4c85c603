#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/report/cause_sizes.h"
#include "server/report/lot_shift.h"
#include "server/report/svg_plot.h"

namespace valvetriage::report {

/// A settled cause of a valve. q_value: core/classify/q_values.h, over all names of the lot.
struct LotReportName {
  std::string cause;
  double probability = 0, q_value = 0;
};

/// One valve of a lot by its newest result; empty texts where there is nothing.
struct LotReportValve {
  std::string serial, received_at, verdict, conclusion;
  std::vector<LotReportName> names;     ///< strongest first
  std::string likely;                   ///< the strongest cause where it is not settled
  double likely_probability = 0;        ///< of it
  std::map<double, double> error_eq20;  ///< level in A → error
  std::string engine_version, settings_sha256, result_sha256;
  std::vector<std::pair<std::string, std::string>> inputs{};  ///< name and SHA-256 of each recording
};

struct LotReportLevel {
  double level_a = 0;
  std::vector<ChartPoint> points;
  std::optional<ChartLimits> limits;
};

/// A group of unexplained valves that leave the same residual.
struct PatternShown {
  std::vector<std::string> members;  ///< serials, most typical first
  std::vector<Panel> panels;         ///< mean residual with one standard deviation on both sides, of each test
};

/// Of the newest `compared` of `unexplained` valves.
struct PatternsShown {
  std::size_t unexplained = 0, compared = 0;
  std::vector<PatternShown> groups;
  std::vector<std::string> alone;  ///< serials like no other
};

struct LotReport {
  std::string lot, first_received_at, last_received_at;
  std::vector<LotReportValve> valves;  ///< oldest first
  std::vector<LotReportLevel> levels;
  LotShifts shifts;
  LotSizes sizes;
  PatternsShown patterns;
};

/// A lot's report, as valve_report_html: verdicts, settled causes most frequent first, the error of each valve at each
/// level with control limits, every valve with the hash of its result.
std::string lot_report_html(const LotReport& report);

}  // namespace valvetriage::report
