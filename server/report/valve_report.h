#pragma once

#include <string>
#include <vector>

#include "server/report/svg_plot.h"
#include "server/wire/analysis_json.h"

namespace valvetriage::report {

/// What is known of the valve beside its analysis; empty where it is not known.
struct ReportSubject {
  std::string serial, lot, valve_type, stand, condition, received_at;
};

/// One recording as the report draws it; no panels: it cannot be drawn, `reason` says why.
struct RecordingPlot {
  std::string name;
  std::vector<Panel> panels;
  std::vector<Stretch> stretches;
  std::string reason;
};

struct ValveReport {
  ReportSubject subject;
  AnalysisDocument analysis;
  std::vector<RecordingPlot> plots;
};

/// A valve's report as one HTML file that needs nothing but itself and prints to A4: verdict, what the simulation gets
/// wrong, each cause with its parameters, the gain, every recording, and from what it was made: engine version, hash of
/// the settings, hashes of the inputs. Every text of a user is escaped; no script. The same input gives the same bytes.
std::string valve_report_html(const ValveReport& report);

}  // namespace valvetriage::report
