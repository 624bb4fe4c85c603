#include "server/jobs/analysis_job.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/discrepancy/settled.h"
#include "server/jobs/analyze_session.h"
#include "server/jobs/reading_child.h"
#include "server/report/curves.h"
#include "server/report/valve_residuals.h"
#include "server/wire/discrepancy_json.h"
#include "server/wire/json_fields.h"
#include "server/wire/reference_json.h"
#include "server/wire/residuals_json.h"
#include "server/wire/rule_base_json.h"

namespace valvetriage {
namespace {

constexpr double kRead = 0.05;  // of the time of a job

Result<AnalysisOptions> analysis_options(const JobSpec& spec) {
  AnalysisOptions options;
  if (spec.reference_json) {
    auto reference = parse_json(*spec.reference_json).and_then(reference_from_json);
    if (!reference) return tl::unexpected(reference.error());
    options.reference = std::move(*reference);
    options.reference->version = spec.reference_version;
  }
  if (spec.rule_base_json) {
    auto rule_base = rule_base_from_json(*spec.rule_base_json);
    if (!rule_base) return tl::unexpected(rule_base.error());
    options.rule_base = std::move(*rule_base);
  }
  return options;
}

Result<ReadRecording> read_file(const JobFile& file, const Labels& labels, const ColumnMapping& mapping) {
  ReadOptions options;
  options.name = file.name;
  options.mapping = mapping;
  options.metadata.serial = labels.serial;
  options.metadata.lot = labels.lot;
  options.metadata.valve_type = labels.valve_type;
  options.metadata.condition = labels.condition;
  options.metadata.stand = labels.stand;
  options.metadata.test = file.test;
  options.allow_mat = true;  // the child is there so that nothing a file does can reach the server
  auto read = read_recording_file(file.path, options);
  if (!read && read.error().code == "cannot_read") read.error().code = kPassingFault;
  return read;
}

/// A cause counts as a name where the contract calls it settled: no rival is left, and nothing is unexplained beside
/// it.
std::vector<CauseSummary> causes_of(const Discrepancy& found) {
  std::vector<CauseSummary> causes;
  for (const NamedCause& cause : found.causes) {
    const bool settled = found.conclusion != Conclusion::kUnexplained && cause.alternatives.empty() &&
                         cause.probability >= kSettledProbability;
    causes.push_back({.cause = cause.cause, .probability = cause.probability, .settled = settled});
  }
  return causes;
}

AnalysisSummary summary_of(const Analysis& analysis) {
  const ClassificationResult& classification = analysis.classification;
  AnalysisSummary summary;
  summary.verdict = classification.verdict;
  if (classification.reason) summary.reason = to_string(*classification.reason);
  summary.action = classification.action;
  if (analysis.discrepancy) {
    summary.conclusion = to_string(analysis.discrepancy->conclusion);
    summary.causes = causes_of(*analysis.discrepancy);
    if (!analysis.discrepancy->causes.empty()) {
      summary.top_cause = analysis.discrepancy->causes.front().cause;
      summary.top_cause_probability = analysis.discrepancy->causes.front().probability;
    }
  }
  for (const LevelFigures& level : analysis.simulation.by_level) {
    if (level.error_eq20) summary.errors.push_back({.level_a = level.level_a, .error_eq20 = *level.error_eq20});
  }
  const auto& responses = analysis.frequency_response;
  const auto smallest =
      std::find_if(responses.begin(), responses.end(), [](const auto& r) { return r.model.has_value(); });
  if (smallest == responses.end()) return summary;
  for (const ResponseFeature& feature : smallest->features) summary.features[feature.name] = feature.value;
  return summary;
}

/// What a lot lays beside each other: unexplained valves, and those in which nothing is wrong.
std::string residuals_of(SessionAnalysis& session) {
  const auto& found = session.analysis.discrepancy;
  if (!found) return "";
  if (found->conclusion != Conclusion::kUnexplained && found->conclusion != Conclusion::kNone) return "";
  const Baseline& baseline = session.analysis.baseline;
  const auto known = report::tests_taken_off(baseline, baseline.reference ? &*baseline.reference : nullptr);
  return residuals_to_json(report::valve_residuals(std::move(session.recordings), baseline.model, known));
}

}  // namespace

Result<NewAnalysis> run_analysis_job(const JobSpec& spec, const StageReport& progress) {
  const auto mapping = column_mapping_of(spec.options_json);
  if (!mapping) return tl::unexpected(mapping.error());
  auto options = analysis_options(spec);
  if (!options) return tl::unexpected(options.error());

  std::vector<ReadRecording> recordings;
  for (const JobFile& file : spec.files) {
    const double done = static_cast<double>(recordings.size()) / static_cast<double>(spec.files.size());
    report_stage(progress, kRead * done, fmt::format("reading {}", file.name));
    auto read = read_file(file, spec.labels, *mapping);
    if (!read) return tl::unexpected(read.error());
    recordings.push_back(std::move(*read));
  }
  options->report = report_part(progress, kRead, 1);
  auto session = analyze_session(std::move(recordings), *options, *mapping);
  if (!session) return tl::unexpected(session.error());
  return NewAnalysis{.engine_version = VALVETRIAGE_VERSION,
                     .settings_sha256 = session->document["engine"]["settings_sha256"].get<std::string>(),
                     .result_sha256 = session->document["result_sha256"].get<std::string>(),
                     .summary = summary_of(session->analysis),
                     .body_json = dump_json(session->document),
                     .residuals_json = residuals_of(*session)};
}

}  // namespace valvetriage
