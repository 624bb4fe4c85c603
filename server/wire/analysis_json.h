#pragma once

#include <map>
#include <string>

#include "core/analysis/analysis.h"
#include "server/wire/json.h"

namespace valvetriage {

/// What the document says about its own making.
struct AnalysisMaking {
  std::string engine_version;
  std::string settings_sha256;             ///< of options, rule base and reference
  std::map<std::string, double> timing_s;  ///< wall time of each stage
};

struct AnalysisDocument {
  Analysis analysis;
  AnalysisMaking making;
  std::string result_sha256;
};

/// The document of schemas/analysis.schema.json. `result_sha256` is computed here.
///
/// Recordings stand in the order of the analysis. A figure that is not finite is null.
Json to_json(const Analysis& analysis, const AnalysisMaking& making);

/// SHA-256 of everything but `timing_s`, the recordings' names and the hash itself.
std::string result_sha256(Json document);

/// Reads a document back. Of the reference only what the document holds (type, version, hash, number of valves) is
/// there.
///
/// Errors  of the fields, each with its JSON pointer; `result_changed` where the hash does not fit the content
Result<AnalysisDocument> analysis_from_json(const Json& document);

/// Names as the contract writes them.
std::string to_string(BaselineKind kind);
std::optional<BaselineKind> baseline_kind_from(const std::string& name);
std::string to_string(NoVerdict reason);

}  // namespace valvetriage
