#include "server/store/sqlite/rows.h"

#include "server/wire/json.h"

namespace valvetriage::sqlite {
namespace {

std::vector<LevelError> errors_from_json(const std::string& text) {
  std::vector<LevelError> errors;
  const Json levels = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  for (const Json& level : levels) errors.push_back({level.at(0).get<double>(), level.at(1).get<double>()});
  return errors;
}

std::map<std::string, double> features_from_json(const std::string& text) {
  std::map<std::string, double> features;
  const Json document = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  for (const auto& [name, value] : document.items()) features[name] = value.get<double>();
  return features;
}

std::vector<CauseSummary> causes_from_json(const std::string& text) {
  std::vector<CauseSummary> causes;
  const Json document = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  for (const Json& cause : document) {
    causes.push_back({.cause = cause.at(0).get<std::string>(),
                      .probability = cause.at(1).get<double>(),
                      .settled = cause.at(2) == Json(1)});
  }
  return causes;
}

}  // namespace

std::string errors_to_json(const std::vector<LevelError>& errors) {
  Json levels = Json::array();
  for (const LevelError& level : errors) levels.push_back({level.level_a, level.error_eq20});
  return dump_json(levels);
}

std::string features_to_json(const std::map<std::string, double>& features) {
  return dump_json(Json(features));
}

std::string causes_to_json(const std::vector<CauseSummary>& causes) {
  Json list = Json::array();
  for (const CauseSummary& cause : causes) list.push_back({cause.cause, cause.probability, cause.settled ? 1 : 0});
  return dump_json(list);
}

JobState read_state(Query& query) {
  const std::string text = query.text();
  const auto state = job_state_from(text);
  if (!state) throw SqliteError(SQLITE_CORRUPT, "a row has the unknown state '" + text + "'");
  return *state;
}

AnalysisSummary read_summary(Query& query) {
  AnalysisSummary summary;
  summary.verdict = query.maybe_text();
  summary.reason = query.maybe_text();
  summary.action = query.maybe_text();
  summary.conclusion = query.maybe_text();
  summary.top_cause = query.maybe_text();
  summary.top_cause_probability = query.maybe_real();
  summary.errors = errors_from_json(query.text());
  summary.features = features_from_json(query.text());
  summary.causes = causes_from_json(query.text());
  return summary;
}

SubmissionAt read_submission(Query& query) {
  SubmissionAt at;
  at.seq = query.integer();
  SubmissionRow& row = at.row;
  row.id = query.text();
  row.job_id = query.text();
  row.state = read_state(query);
  row.received_at = query.integer();
  row.labels.lot = query.maybe_text();
  row.labels.serial = query.maybe_text();
  row.labels.valve_type = query.maybe_text();
  row.labels.condition = query.maybe_text();
  row.labels.stand = query.maybe_text();
  row.recordings = query.integer();
  row.problem_json = query.maybe_text();
  row.summary = read_summary(query);
  return at;
}

RecordingAt read_recording(Query& query, const SubmissionRow& submission) {
  RecordingAt at;
  at.seq = query.integer();
  RecordingRow& row = at.row;
  row.id = query.text();
  row.name = query.text();
  row.sha256 = query.text();
  row.size_bytes = query.integer();
  row.test = query.maybe_text();
  row.metadata_json = query.text();
  row.submission_id = submission.id;
  row.job_id = submission.job_id;
  row.state = submission.state;
  row.received_at = submission.received_at;
  row.labels = submission.labels;
  row.summary = submission.summary;
  row.problem_json = submission.problem_json;
  return at;
}

}  // namespace valvetriage::sqlite
