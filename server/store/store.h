#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "server/store/clock.h"

namespace valvetriage {

// ---------------------------------------------------------------------------------------------------------------------
// Rows. Every id is a prefix and 26 characters, random but ordered by time: rec_ sub_ job_ ana_ fnd_ tok_.
// Text that may be absent is optional; an empty string is never stored for "absent".

/// States of recordings, submissions and jobs (contract, section 5).
enum class JobState { kQueued, kRunning, kDone, kFailed, kRejected, kPoisoned, kCancelled };

inline constexpr std::array kJobStates = {JobState::kQueued,   JobState::kRunning,  JobState::kDone,
                                          JobState::kFailed,   JobState::kRejected, JobState::kPoisoned,
                                          JobState::kCancelled};

/// "queued", "running", ...
std::string_view to_text(JobState state);
std::optional<JobState> job_state_from(std::string_view text);

/// Nothing happens any more to a job in this state.
constexpr bool is_final(JobState state) {
  return state != JobState::kQueued && state != JobState::kRunning;
}

/// Labels of a valve's test: what is filtered and grouped by. `tested_at`, `operator` and the like stay in
/// `metadata_json`.
struct Labels {
  std::optional<std::string> lot{};
  std::optional<std::string> serial{};
  std::optional<std::string> valve_type{};
  std::optional<std::string> condition{};
  std::optional<std::string> stand{};

  bool operator==(const Labels&) const = default;
};

struct LevelError {
  double level_a = 0;
  double error_eq20 = 0;

  bool operator==(const LevelError&) const = default;
};

/// One entry of `discrepancy.causes`. settled: it has no rival left and its result is not `unexplained`, so that it
/// counts as a name.
struct CauseSummary {
  std::string cause{};
  double probability = 0;
  bool settled = false;

  bool operator==(const CauseSummary&) const = default;
};

/// What lists, lots and charts show of an analysis, kept beside it so that no list opens a body.
///
/// top_cause             the strongest entry of `discrepancy.causes`; absent where there is none
/// causes                every entry, strongest first
/// errors                Eq 20 error by current level
/// features              of the frequency response at the smallest amplitude, by name with its unit: bandwidth_hz, …;
///                       empty without a sweep
struct AnalysisSummary {
  std::optional<std::string> verdict{};
  std::optional<std::string> reason{};
  std::optional<std::string> action{};
  std::optional<std::string> conclusion{};
  std::optional<std::string> top_cause{};
  std::optional<double> top_cause_probability{};
  std::vector<CauseSummary> causes{};
  std::vector<LevelError> errors{};
  std::map<std::string, double> features{};

  bool operator==(const AnalysisSummary&) const = default;
};

/// One stored file. A recording sent alone is a submission of one; it always shows its submission's state and summary.
///
/// sha256         of the expanded bytes, 64 hex digits: the name of the blob
/// metadata_json  everything the sender said about it, as one JSON object
/// problem_json   why it was rejected or failed: a problem document; absent otherwise
struct RecordingRow {
  std::string id{};
  std::string submission_id{};
  std::string job_id{};
  JobState state = JobState::kQueued;
  TimestampMs received_at = 0;
  std::string name{};
  std::string sha256{};
  std::int64_t size_bytes = 0;
  Labels labels{};
  std::optional<std::string> test{};
  std::string metadata_json{};
  AnalysisSummary summary{};
  std::optional<std::string> problem_json{};
};

/// The recordings of one valve that are analysed together. `job_id` is the newest job. Once there is a result the state
/// stays `done`; a later analysis that fails shows in its own job.
struct SubmissionRow {
  std::string id{};
  std::string job_id{};
  JobState state = JobState::kQueued;
  TimestampMs received_at = 0;
  Labels labels{};
  std::int64_t recordings = 0;
  AnalysisSummary summary{};
  std::optional<std::string> problem_json{};
};

/// Identifies one run of one job: whoever holds an older token may no longer finish it.
struct LeaseToken {
  std::string job_id{};
  std::int64_t fence = 0;
};

/// attempt        how often it was started, counting this one
/// crashes        how often its child died; 3 and the job is poisoned
/// options_json   what the analysis was asked for: column mapping, baseline, rule base
/// progress       0 to 1, with what is being done
struct JobRow {
  std::string id{};
  std::string submission_id{};
  JobState state = JobState::kQueued;
  TimestampMs created_at = 0;
  std::optional<TimestampMs> started_at{};
  std::optional<TimestampMs> finished_at{};
  int attempt = 0;
  int crashes = 0;
  std::string options_json{};
  double progress = 0;
  std::string progress_note{};
  std::optional<std::string> analysis_id{};
  std::optional<std::string> problem_json{};
  std::int64_t fence = 0;

  LeaseToken lease() const { return {id, fence}; }
};

/// One result; never changed, never replaced. The body is the contract's analysis document.
struct AnalysisRow {
  std::string id{};
  std::string submission_id{};
  std::string job_id{};
  TimestampMs created_at = 0;
  std::string engine_version{};
  std::string settings_sha256{};
  std::string result_sha256{};
  AnalysisSummary summary{};
};

/// A versioned JSON document per valve type: the newest serves.
enum class DocumentKind { kReference, kRuleBase };

struct DocumentRow {
  DocumentKind kind = DocumentKind::kReference;
  std::string valve_type{};
  int version = 0;
  std::string sha256{};
  TimestampMs created_at = 0;
  std::string created_by{};
};

/// What teardown found in a valve.
struct FindingRow {
  std::string id{};
  std::string serial{};
  std::string cause{};
  std::string found_by{};
  TimestampMs found_at = 0;
  std::string note{};
  TimestampMs created_at = 0;
};

/// An access token. The secret itself is never stored, only its SHA-256. `scopes` is a set of submit, read, admin.
struct TokenRow {
  std::string id{};
  std::string name{};
  std::vector<std::string> scopes{};
  TimestampMs created_at = 0;
  std::optional<TimestampMs> revoked_at{};
};

/// One change. `cursor` only ever grows, in the order the changes were committed. Never updated, never deleted.
///
/// kind     "recording.accepted", "job.running", "job.progress", "job.done", "analysis.stored", "reference.added", ...
/// subject  the id of what changed
/// actor    who did it: a token's id, "local", or "worker"
struct EventRow {
  std::int64_t cursor = 0;
  TimestampMs at = 0;
  std::string kind{};
  std::string subject{};
  std::string actor{};
  std::string detail_json{};
};

/// A lot, counted by valve (by serial; without one every submission counts as a valve), each by its newest result.
///
/// verdicts   verdict -> valves; the empty key stands for a result without a verdict
/// causes     settled cause -> valves; a valve counts with each of its own
struct LotRow {
  std::string lot{};
  TimestampMs first_received_at = 0;
  TimestampMs last_received_at = 0;
  std::int64_t recordings = 0;
  std::int64_t submissions = 0;
  std::int64_t valves = 0;
  std::int64_t analysed_valves = 0;
  std::map<std::string, std::int64_t> verdicts{};
  std::map<std::string, std::int64_t> causes{};
};

// ---------------------------------------------------------------------------------------------------------------------
// Requests

/// One file of a submission whose blob is already durable.
struct NewRecording {
  std::string name{};
  std::string sha256{};
  std::int64_t size_bytes = 0;
  std::optional<std::string> test{};
  std::string metadata_json = "{}";
};

/// `principal` keeps the keys of two tokens apart.
struct IdempotencyKey {
  std::string principal{};
  std::string key{};
};

/// request_sha256   of what was asked; the same key with another hash is a conflict
/// alone            sent to /v1/recordings: sameness is that of the recording, wherever it was first accepted;
/// otherwise
///                  sameness is that of the whole submission
/// max_queued_jobs  admission: beyond this the store refuses with `overloaded`
struct NewSubmission {
  Labels labels{};
  std::vector<NewRecording> recordings{};
  bool alone = false;
  std::string options_json = "{}";
  std::string request_sha256{};
  std::optional<IdempotencyKey> idempotency{};
  std::string actor = "local";
  std::int64_t max_queued_jobs = 100'000;
};

/// created    stored now: 202
/// replayed   the same Idempotency-Key asked the same before: the same answer again (`first_created` tells 202 from
/// 200) duplicate  the same bytes for the same lot and serial are there already: 200 and the first one
enum class AcceptKind { kCreated, kReplayed, kDuplicate };

struct Accepted {
  AcceptKind kind = AcceptKind::kCreated;
  bool first_created = true;
  SubmissionRow submission{};
  std::vector<RecordingRow> recordings{};  ///< where `alone`, exactly the one that was asked for
};

/// A result to store: summary for the lists, `body_json` the whole document. `residuals_json` is what the simulation
/// leaves, coarse, for the lot to compare valves by; empty where nothing is kept.
struct NewAnalysis {
  std::string engine_version{};
  std::string settings_sha256{};
  std::string result_sha256{};
  AnalysisSummary summary{};
  std::string body_json{};
  std::string residuals_json{};
};

/// How an attempt that gave no analysis ended.
///
/// kRejected   bad input: final at once
/// kFault      a fault that passes: again after a backoff, `failed` when the attempts are used up
/// kTimeout    as kFault, but only once more
/// kCrash      the child died: again, `poisoned` at the third
/// kFailed     a fault that repeating cannot mend: final at once
/// kReturned   handed back by a server that is going down: queued again, the attempt not counted
enum class AttemptEnd { kRejected, kFault, kTimeout, kCrash, kFailed, kReturned };

/// All given fields must match. `cause` is any cause of the newest result, settled or not. `since` is inclusive,
/// `until` exclusive, of received_at.
struct Filter {
  std::optional<std::string> lot{};
  std::optional<std::string> serial{};
  std::optional<std::string> valve_type{};
  std::optional<std::string> stand{};
  std::optional<std::string> verdict{};
  std::optional<std::string> cause{};
  std::optional<TimestampMs> since{};
  std::optional<TimestampMs> until{};
};

/// `cursor` as an earlier page's `next` gave it.
struct PageRequest {
  int limit = 50;
  std::optional<std::string> cursor{};
};

inline constexpr int kMaxPageLimit = 1000;

template <typename Row>
struct Page {
  std::vector<Row> items{};
  std::optional<std::string> next{};
};

/// Jobs by state, and the age of the oldest one that waits.
struct QueueStats {
  std::map<JobState, std::int64_t> jobs{};
  std::optional<TimestampMs> oldest_queued_at{};
};

struct DocumentBody {
  DocumentRow row{};
  std::string body_json{};
};

struct NewFinding {
  std::string serial{};
  std::string cause{};
  std::string found_by{};
  std::optional<TimestampMs> found_at{};  ///< now where absent
  std::string note{};
  std::string actor = "local";
};

struct NewToken {
  std::string name{};
  std::string secret_sha256{};
  std::vector<std::string> scopes{};
  std::string actor = "local";
};

// ---------------------------------------------------------------------------------------------------------------------

/// Everything the service remembers, whatever keeps it. Nothing outside server/store/ knows which database it is; every
/// implementation passes tests/contract/store_contract_test.cpp.
///
/// A call that changes something is one transaction with its row in the events, and returns only when it is durable.
/// A call that reads sees one consistent state. All calls may be made from any thread.
///
/// Errors  `not_found`; `invalid_cursor`; `invalid_limit`; `idempotency_conflict`; `overloaded`; `lease_lost`;
///         `not_cancellable`; `no_space` (the disk is full); `store_busy` (passes: answer 503); `store_broken` (needs
///         an operator)
class Store {
 public:
  virtual ~Store() = default;

  // --- accepting -----------------------------------------------------------------------------------------------------
  /// One transaction: idempotency, sameness, admission, submission, recordings, job, lot, event.
  virtual Result<Accepted> accept(const NewSubmission& submission) = 0;

  // --- recordings and submissions ------------------------------------------------------------------------------------
  virtual Result<RecordingRow> recording(std::string_view id) = 0;
  virtual Result<SubmissionRow> submission(std::string_view id) = 0;
  virtual Result<std::vector<RecordingRow>> recordings_of(std::string_view submission_id) = 0;
  /// Newest first.
  virtual Result<Page<RecordingRow>> list_recordings(const Filter& filter, const PageRequest& page) = 0;
  virtual Result<Page<SubmissionRow>> list_submissions(const Filter& filter, const PageRequest& page) = 0;

  // --- jobs ----------------------------------------------------------------------------------------------------------
  virtual Result<JobRow> job(std::string_view id) = 0;
  /// A new analysis beside the old ones. Errors: `overloaded` beyond `max_queued_jobs`.
  virtual Result<JobRow> reanalyze(std::string_view submission_id, std::string_view options_json,
                                   std::string_view actor, std::int64_t max_queued_jobs) = 0;
  /// The longest-waiting job that may run now, leased to `worker` for `lease_ms`; nothing when there is none.
  virtual Result<std::optional<JobRow>> claim(std::string_view worker, std::int64_t lease_ms) = 0;
  /// Prolongs the lease and notes progress. `lease_lost` if the job is no longer ours: stop and discard.
  virtual Result<void> heartbeat(const LeaseToken& lease, std::int64_t lease_ms, double progress,
                                 std::string_view progress_note) = 0;
  /// The result and the end of the job, one transaction. `lease_lost` if the job is no longer ours: nothing is stored.
  virtual Result<AnalysisRow> finish(const LeaseToken& lease, const NewAnalysis& analysis) = 0;
  /// The end of an attempt without a result; the job's state afterwards. `lease_lost` as above.
  virtual Result<JobRow> end_attempt(const LeaseToken& lease, AttemptEnd end, std::string_view problem_json) = 0;
  /// Cancelled at once, running or not: whoever runs it has lost the lease and stops. Final already: `not_cancellable`.
  virtual Result<JobRow> cancel(std::string_view job_id, std::string_view actor) = 0;
  /// Leases that ran out: back to the queue, or poisoned. Returns how many.
  virtual Result<int> expire_leases() = 0;
  /// At start, before any worker: every lease a dead process of this machine holds goes back to the queue, uncounted as
  /// attempts. Returns how many.
  virtual Result<int> release_dead_leases() = 0;
  virtual Result<QueueStats> queue_stats() = 0;

  // --- analyses ------------------------------------------------------------------------------------------------------
  /// Newest first.
  virtual Result<std::vector<AnalysisRow>> analyses_of(std::string_view submission_id) = 0;
  virtual Result<AnalysisRow> newest_analysis(std::string_view submission_id) = 0;
  virtual Result<std::string> analysis_body(std::string_view analysis_id) = 0;
  /// `residuals_json` of the submission's newest analysis; empty where it kept none.
  virtual Result<std::string> newest_residuals(std::string_view submission_id) = 0;

  // --- references and rule bases -------------------------------------------------------------------------------------
  /// The next version of this valve type's document, under the hash that the document itself and analyses give it. The
  /// same hash as the newest again: that version, nothing is added.
  virtual Result<DocumentRow> add_document(DocumentKind kind, std::string_view valve_type, std::string_view body_json,
                                           std::string_view sha256, std::string_view actor) = 0;
  /// The newest, or the given version.
  virtual Result<DocumentBody> document(DocumentKind kind, std::string_view valve_type,
                                        std::optional<int> version = std::nullopt) = 0;
  /// Newest first.
  virtual Result<std::vector<DocumentRow>> list_documents(DocumentKind kind, std::string_view valve_type) = 0;

  // --- lots and valves -----------------------------------------------------------------------------------------------
  /// Newest lot first.
  virtual Result<Page<LotRow>> list_lots(const PageRequest& page) = 0;
  virtual Result<LotRow> lot(std::string_view lot) = 0;
  virtual Result<FindingRow> add_finding(const NewFinding& finding) = 0;
  /// Oldest first. A valve that nobody has found anything in has none.
  virtual Result<std::vector<FindingRow>> findings(std::string_view serial) = 0;
  /// Of all valves, newest first, `limit` at most.
  virtual Result<std::vector<FindingRow>> newest_findings(int limit) = 0;

  // --- tokens --------------------------------------------------------------------------------------------------------
  virtual Result<TokenRow> add_token(const NewToken& token) = 0;
  /// The token with this secret's hash, unless it is revoked.
  virtual Result<TokenRow> token_by_secret(std::string_view secret_sha256) = 0;
  virtual Result<std::vector<TokenRow>> list_tokens() = 0;
  virtual Result<void> revoke_token(std::string_view id, std::string_view actor) = 0;

  // --- events --------------------------------------------------------------------------------------------------------
  /// Changes after `cursor` (0: from the first), oldest first.
  virtual Result<std::vector<EventRow>> events_after(std::int64_t cursor, int limit) = 0;
  /// Cursor of the newest change; 0 before the first.
  virtual Result<std::int64_t> newest_event() = 0;

  // --- operations ----------------------------------------------------------------------------------------------------
  /// Proves that a write would be durable now.
  virtual Result<void> probe() = 0;
  /// Which database this is, for as long as it lives; a backup is the same one.
  virtual Result<std::string> identity() = 0;
  /// Whether a recording names this blob.
  virtual Result<bool> blob_is_referenced(std::string_view sha256) = 0;
  /// Every blob a recording names, each once, in order, after `after`; at most `limit`.
  virtual Result<std::vector<std::string>> referenced_blobs(std::string_view after, int limit) = 0;
  /// Sentences that say what is damaged; none when all is well.
  virtual Result<std::vector<std::string>> check() = 0;
  /// A consistent copy of everything into a new file, while work goes on.
  virtual Result<void> backup(const std::string& file) = 0;
};

}  // namespace valvetriage
