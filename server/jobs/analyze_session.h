#pragma once

#include <vector>

#include "core/analysis/analyze.h"
#include "server/wire/analysis_json.h"
#include "server/wire/read_recording.h"

namespace valvetriage {

/// An analysis, its document, and which of the given recordings each of its own is.
struct SessionAnalysis {
  Analysis analysis;
  Json document;                      ///< schemas/analysis.schema.json
  std::vector<Recording> recordings;  ///< as they were analysed, in the analysis' order
  std::vector<std::size_t> order;     ///< order[i]: place in the argument of the analysis' recording i
};

/// Analyses one valve's recordings together, in the order of their hashes, so that the order of files does not matter.
///
/// mapping  how the recordings were read: part of the settings, like options, rule base and reference
/// Errors   `no_recordings`; `several_valves` where the serials differ;
///          `contradicting_metadata` where a valve is of another type than the reference it would be compared with;
///          those of `analyze`
Result<SessionAnalysis> analyze_session(std::vector<ReadRecording> recordings, const AnalysisOptions& options,
                                        const ColumnMapping& mapping);

/// SHA-256 of everything but the recordings that the result depends on.
std::string settings_sha256(const AnalysisOptions& options, const ColumnMapping& mapping);

}  // namespace valvetriage
