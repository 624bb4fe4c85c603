#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/store/sqlite/connection.h"
#include "server/store/store.h"

/// How rows stand in columns: each list of columns next to the function that reads it.
namespace valvetriage::sqlite {

inline constexpr std::string_view kSubmissionColumns =
    "s.seq, s.id, s.job_id, s.state, s.received_at, s.lot, s.serial, s.valve_type, s.condition, s.stand, s.recordings, "
    "s.problem, s.verdict, s.reason, s.action, s.conclusion, s.top_cause, s.top_cause_probability, s.errors, "
    "s.features, s.causes";

struct SubmissionAt {
  std::int64_t seq = 0;
  SubmissionRow row;
};
SubmissionAt read_submission(Query& query);

inline constexpr std::string_view kRecordingColumns = "r.seq, r.id, r.name, r.sha256, r.size_bytes, r.test, r.metadata";

struct RecordingAt {
  std::int64_t seq = 0;
  RecordingRow row;
};
/// What a recording shows of its submission comes from `submission`.
RecordingAt read_recording(Query& query, const SubmissionRow& submission);

AnalysisSummary read_summary(Query& query);
std::string errors_to_json(const std::vector<LevelError>& errors);
std::string features_to_json(const std::map<std::string, double>& features);
std::string causes_to_json(const std::vector<CauseSummary>& causes);

JobState read_state(Query& query);

}  // namespace valvetriage::sqlite
