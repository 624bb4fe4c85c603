#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/store/sqlite/connection.h"
#include "server/store/store.h"

/// The calls of Store as functions of a connection: the writing ones inside a transaction of the writer lane, the
/// reading ones inside a reader's. Their meaning stands in store.h. All throw SqliteError.
namespace valvetriage::sqlite {

struct Write {
  Connection& connection;
  const Clock& clock;
};

void add_event(const Write& in, std::string_view kind, std::string_view subject, std::string_view actor,
               std::string_view detail_json = "{}");

// accepting.cpp
Result<Accepted> accept(const Write& in, const NewSubmission& submission);
/// Refuses with `overloaded` where `max_queued_jobs` wait already, otherwise queues a job and returns its id.
Result<std::string> enqueue(const Write& in, std::int64_t submission_seq, std::string_view options_json,
                            std::string_view actor, std::int64_t max_queued_jobs);

// lists.cpp
Result<RecordingRow> recording(Connection& connection, std::string_view id);
Result<SubmissionRow> submission(Connection& connection, std::string_view id);
Result<SubmissionRow> submission_at(Connection& connection, std::int64_t seq);
Result<std::int64_t> submission_seq(Connection& connection, std::string_view id);
std::vector<RecordingRow> recordings_at(Connection& connection, std::int64_t submission_seq);
Result<Page<RecordingRow>> list_recordings(Connection& connection, const Filter& filter, const PageRequest& page);
Result<Page<SubmissionRow>> list_submissions(Connection& connection, const Filter& filter, const PageRequest& page);
Result<Page<LotRow>> list_lots(Connection& connection, const PageRequest& page);
Result<LotRow> lot(Connection& connection, std::string_view name);

// jobs.cpp
Result<JobRow> job(Connection& connection, std::string_view id);
Result<JobRow> reanalyze(const Write& in, std::string_view submission_id, std::string_view options_json,
                         std::string_view actor, std::int64_t max_queued_jobs);
Result<std::optional<JobRow>> claim(const Write& in, std::string_view worker, std::int64_t lease_ms);
Result<void> heartbeat(const Write& in, const LeaseToken& lease, std::int64_t lease_ms, double progress,
                       std::string_view progress_note);
/// body_zstd  the compressed document
Result<AnalysisRow> finish(const Write& in, const LeaseToken& lease, const NewAnalysis& analysis,
                           std::string_view body_zstd, std::string_view residuals_zstd);
Result<JobRow> end_attempt(const Write& in, const LeaseToken& lease, AttemptEnd end, std::string_view problem_json);
Result<JobRow> cancel(const Write& in, std::string_view job_id, std::string_view actor);
Result<int> expire_leases(const Write& in);
Result<int> release_dead_leases(const Write& in);
Result<QueueStats> queue_stats(Connection& connection);

// records.cpp
Result<std::vector<AnalysisRow>> analyses_of(Connection& connection, std::string_view submission_id);
Result<AnalysisRow> newest_analysis(Connection& connection, std::string_view submission_id);
Result<AnalysisRow> analysis_of_job(Connection& connection, std::string_view job_id);
Result<std::string> analysis_body_zstd(Connection& connection, std::string_view analysis_id);
/// Of the newest analysis; empty where it kept none.
Result<std::string> newest_residuals_zstd(Connection& connection, std::string_view submission_id);
/// A document whose body is still compressed.
struct StoredDocument {
  DocumentRow row;
  std::string body_zstd;
};
Result<DocumentRow> add_document(const Write& in, DocumentKind kind, std::string_view valve_type,
                                 std::string_view sha256, std::string_view body_zstd, std::string_view actor);
Result<StoredDocument> document(Connection& connection, DocumentKind kind, std::string_view valve_type,
                                std::optional<int> version);
Result<std::vector<DocumentRow>> list_documents(Connection& connection, DocumentKind kind, std::string_view valve_type);
Result<FindingRow> add_finding(const Write& in, const NewFinding& finding);
Result<std::vector<FindingRow>> findings(Connection& connection, std::string_view serial);
Result<std::vector<FindingRow>> newest_findings(Connection& connection, int limit);
Result<TokenRow> add_token(const Write& in, const NewToken& token);
Result<TokenRow> token_by_secret(Connection& connection, std::string_view secret_sha256);
Result<std::vector<TokenRow>> list_tokens(Connection& connection);
Result<void> revoke_token(const Write& in, std::string_view id, std::string_view actor);
Result<std::vector<EventRow>> events_after(Connection& connection, std::int64_t cursor, int limit);
Result<std::int64_t> newest_event(Connection& connection);
Result<std::string> identity(Connection& connection);
Result<bool> blob_is_referenced(Connection& connection, std::string_view sha256);
Result<std::vector<std::string>> referenced_blobs(Connection& connection, std::string_view after, int limit);
Result<std::vector<std::string>> check(Connection& connection);
Result<void> backup(Connection& connection, const std::string& file);

}  // namespace valvetriage::sqlite
