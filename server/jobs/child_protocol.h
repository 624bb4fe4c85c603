#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "core/stage.h"
#include "server/store/store.h"
#include "server/wire/json.h"
#include "server/wire/json_fields.h"

namespace valvetriage {

/// One recording as the child gets it.
struct JobFile {
  std::string name{};
  std::string sha256{};
  std::string path{};
  std::optional<std::string> test{};
  std::string metadata_json{};
};

/// All that an analysis depends on: the same spec and version give the same result.
///
/// options_json    as the upload asked: column mapping, sample rate
/// reference_json, rule_base_json   the documents that serve, absent where there are none
struct JobSpec {
  std::string job_id{};
  std::string submission_id{};
  std::vector<JobFile> files{};
  Labels labels{};
  std::string options_json = "{}";
  std::optional<std::string> reference_json{};
  std::optional<std::string> rule_base_json{};
  int reference_version = 0;  ///< as the store numbers it
};

/// The work itself: a spec in, the result to store out. An Error with code `input_fault_passes` (a blob that could not
/// be read just now) is tried again; any other is bad input, and final.
using AnalyseJob = std::function<Result<NewAnalysis>(const JobSpec& spec, const StageReport& progress)>;

inline constexpr std::string_view kPassingFault = "input_fault_passes";

/// The hidden verb of the binary that runs one job: `valvetriage analysis-child`.
inline constexpr std::string_view kChildVerb = "analysis-child";

// The spec is one JSON document on the child's standard input. Its answer is lines of JSON on standard output: any
// number of
// {"progress":0.5,"note":"..."}, then one {"done":{...}} or {"rejected":{problem}} or {"fault":{problem}}.

std::string to_json_text(const JobSpec& spec);
Result<JobSpec> job_spec_from(std::string_view text);

std::string progress_line(double fraction, std::string_view note);
std::string done_line(const NewAnalysis& analysis);
std::string refused_line(const Error& error);

/// A problem document of what went wrong: code, detail and position.
std::string problem_json(const Error& error);

/// What a child was asked for and refused, as it says it and as it is read again.
Json refusal_json(const Error& error);
Error refusal_from(JsonFields fields);

struct ChildProgress {
  double fraction = 0;
  std::string note{};
};

/// One line of the child, read. Exactly one of them is set.
struct ChildMessage {
  std::optional<ChildProgress> progress{};
  std::optional<NewAnalysis> done{};
  std::optional<std::string> rejected_json{};
  std::optional<std::string> fault_json{};
};
Result<ChildMessage> child_message_from(std::string_view line);

/// The child's whole life: reads the spec from standard input, runs `analyse`, writes its lines. The exit status: 0
/// when an answer was given, whatever it was.
int run_child(const AnalyseJob& analyse);

}  // namespace valvetriage
