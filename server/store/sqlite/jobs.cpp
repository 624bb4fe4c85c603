#include <fmt/format.h>

#include "server/store/id.h"
#include "server/store/retry_policy.h"
#include "server/store/sqlite/operations.h"
#include "server/store/sqlite/rows.h"
#include "server/wire/json.h"

namespace valvetriage::sqlite {
namespace {

constexpr std::string_view kJobColumns =
    "j.seq, j.id, s.id, j.state, j.created_at, j.started_at, j.finished_at, j.attempt, j.crashes, j.options, "
    "j.progress, "
    "j.progress_note, a.id, j.problem, j.fence, j.timeouts, j.submission_seq";

/// What the store needs of a job beside its row.
struct JobAt {
  std::int64_t seq = 0;
  JobRow row;
  int timeouts = 0;
  std::int64_t submission_seq = 0;
};

JobAt read_job(Query& query) {
  JobAt at;
  at.seq = query.integer();
  JobRow& row = at.row;
  row.id = query.text();
  row.submission_id = query.text();
  row.state = read_state(query);
  row.created_at = query.integer();
  row.started_at = query.maybe_integer();
  row.finished_at = query.maybe_integer();
  row.attempt = static_cast<int>(query.integer());
  row.crashes = static_cast<int>(query.integer());
  row.options_json = query.text();
  row.progress = query.real();
  row.progress_note = query.text();
  row.analysis_id = query.maybe_text();
  row.problem_json = query.maybe_text();
  row.fence = query.integer();
  at.timeouts = static_cast<int>(query.integer());
  at.submission_seq = query.integer();
  return at;
}

Result<JobAt> job_at(Connection& connection, std::string_view id) {
  static const std::string sql = fmt::format(
      "SELECT {} FROM jobs j JOIN submissions s ON s.seq = j.submission_seq LEFT JOIN analyses a ON a.job_id = j.id "
      "WHERE j.id = ?",
      kJobColumns);
  Query query = connection.query(sql, id);
  if (!query.next()) return fail("not_found", fmt::format("there is no job '{}'", id));
  return read_job(query);
}

/// The job, if this lease still holds it.
Result<JobAt> leased_job(Connection& connection, const LeaseToken& lease) {
  auto job = job_at(connection, lease.job_id);
  if (job && (job->row.state != JobState::kRunning || job->row.fence != lease.fence)) {
    return fail("lease_lost", fmt::format("the job {} is no longer this worker's", lease.job_id));
  }
  return job;
}

/// The submission follows its newest job, but once it has a result it stays done.
void follow_job(const Write& in, const JobAt& job, JobState state, const std::optional<std::string>& problem_json) {
  in.connection.run("UPDATE submissions SET state = ?, problem = ? WHERE seq = ? AND job_id = ? AND state <> 'done'",
                    to_text(state), problem_json, job.submission_seq, job.row.id);
}

void end_job(const Write& in, const JobAt& job, JobState state, const std::optional<std::string>& problem_json,
             std::string_view actor) {
  in.connection.run(
      "UPDATE jobs SET state = ?, finished_at = ?, problem = ?, worker = NULL, lease_until = NULL, fence = fence + 1 "
      "WHERE seq = ?",
      to_text(state), in.clock.utc_ms(), problem_json, job.seq);
  follow_job(in, job, state, problem_json);
  add_event(in, fmt::format("job.{}", to_text(state)), job.row.id, actor);
}

void queue_again(const Write& in, const JobAt& job, std::int64_t not_before) {
  in.connection.run(
      "UPDATE jobs SET state = 'queued', not_before = ?, worker = NULL, lease_until = NULL, fence = fence + 1, "
      "progress = 0, "
      "progress_note = '' WHERE seq = ?",
      not_before, job.seq);
  follow_job(in, job, JobState::kQueued, std::nullopt);
  add_event(in, "job.queued", job.row.id, "worker");
}

void apply_step(const Write& in, const JobAt& job, AttemptEnd end, std::string_view problem_json) {
  const NextStep step = next_step(end, {job.row.attempt, job.row.crashes, job.timeouts});
  in.connection.run("UPDATE jobs SET attempt = ?, crashes = ?, timeouts = ? WHERE seq = ?", step.counts.attempts,
                    step.counts.crashes, step.counts.timeouts, job.seq);
  if (step.state == JobState::kQueued) {
    // What is handed back goes to the front: it waited its turn already.
    queue_again(in, job, end == AttemptEnd::kReturned ? 0 : in.clock.steady_ms() + step.delay_ms);
  } else {
    end_job(in, job, step.state, std::string(problem_json), "worker");
  }
}

std::int64_t insert_analysis(const Write& in, const JobAt& job, const NewAnalysis& analysis, std::string_view body_zstd,
                             std::string_view residuals_zstd) {
  const AnalysisSummary& summary = analysis.summary;
  const TimestampMs now = in.clock.utc_ms();
  in.connection.run(
      "INSERT INTO analyses (id, submission_seq, job_id, created_at, engine_version, settings_sha256, result_sha256, "
      "verdict, reason, action, conclusion, top_cause, top_cause_probability, errors, features, causes) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
      new_id("ana_", now), job.submission_seq, job.row.id, now, analysis.engine_version, analysis.settings_sha256,
      analysis.result_sha256, summary.verdict, summary.reason, summary.action, summary.conclusion, summary.top_cause,
      summary.top_cause_probability, errors_to_json(summary.errors), features_to_json(summary.features),
      causes_to_json(summary.causes));
  const std::int64_t seq = in.connection.last_row();
  in.connection.run("INSERT INTO analysis_bodies VALUES (?, ?)", seq, Blob{body_zstd});
  if (!residuals_zstd.empty())
    in.connection.run("INSERT INTO analysis_residuals VALUES (?, ?)", seq, Blob{residuals_zstd});
  return seq;
}

void list_causes(const Write& in, const JobAt& job, const AnalysisSummary& summary) {
  in.connection.run("DELETE FROM submission_causes WHERE submission_seq = ?", job.submission_seq);
  for (const CauseSummary& cause : summary.causes) {
    in.connection.run(
        "INSERT OR IGNORE INTO submission_causes SELECT ?2, received_at, seq FROM submissions WHERE seq = ?1",
        job.submission_seq, cause.cause);
  }
}

/// Where this result is the one its valve counts with.
void count_causes_in_lot(const Write& in, const JobAt& job, const AnalysisSummary& summary) {
  in.connection.run(
      "DELETE FROM lot_causes WHERE (lot, valve) IN (SELECT lot, valve FROM lot_valves v JOIN submissions s "
      "USING (lot) WHERE s.seq = ?1 AND v.valve = coalesce('serial ' || s.serial, s.id) AND v.result_seq = ?1)",
      job.submission_seq);
  for (const CauseSummary& cause : summary.causes) {
    if (!cause.settled) continue;
    in.connection.run(
        "INSERT OR IGNORE INTO lot_causes SELECT lot, ?2, valve FROM lot_valves v JOIN submissions s USING (lot) WHERE "
        "s.seq = ?1 "
        "AND v.valve = coalesce('serial ' || s.serial, s.id) AND v.result_seq = ?1",
        job.submission_seq, cause.cause);
  }
}

void show_summary(const Write& in, const JobAt& job, const AnalysisSummary& summary) {
  in.connection.run(
      "UPDATE submissions SET state = 'done', problem = NULL, verdict = ?, reason = ?, action = ?, conclusion = ?, "
      "top_cause = ?, top_cause_probability = ?, errors = ?, features = ?, causes = ? WHERE seq = ?",
      summary.verdict, summary.reason, summary.action, summary.conclusion, summary.top_cause,
      summary.top_cause_probability, errors_to_json(summary.errors), features_to_json(summary.features),
      causes_to_json(summary.causes), job.submission_seq);
  list_causes(in, job, summary);
  // A valve counts with its newest result: one of an older submission does not displace it.
  in.connection.run(
      "UPDATE lot_valves SET result_seq = ?1, verdict = ?2 FROM submissions s WHERE s.seq = ?1 AND "
      "lot_valves.lot = s.lot AND lot_valves.valve = coalesce('serial ' || s.serial, s.id) AND "
      "(result_seq IS NULL OR result_seq <= ?1)",
      job.submission_seq, summary.verdict.value_or(""));
  count_causes_in_lot(in, job, summary);
}

std::vector<std::string> ids(Query query) {
  std::vector<std::string> found;
  while (query.next()) found.push_back(query.text());
  return found;
}

}  // namespace

Result<JobRow> job(Connection& connection, std::string_view id) {
  const auto at = job_at(connection, id);
  if (!at) return tl::unexpected(at.error());
  return at->row;
}

Result<JobRow> reanalyze(const Write& in, std::string_view submission_id, std::string_view options_json,
                         std::string_view actor, std::int64_t max_queued_jobs) {
  const auto seq = submission_seq(in.connection, submission_id);
  if (!seq) return tl::unexpected(seq.error());
  const auto id = enqueue(in, *seq, options_json, actor, max_queued_jobs);
  if (!id) return tl::unexpected(id.error());
  return job(in.connection, *id);
}

Result<std::optional<JobRow>> claim(const Write& in, std::string_view worker, std::int64_t lease_ms) {
  const std::int64_t steady_now = in.clock.steady_ms();
  const auto waiting = ids(in.connection.query(
      "SELECT id FROM jobs WHERE state = 'queued' AND not_before <= ? ORDER BY not_before, seq LIMIT 1", steady_now));
  if (waiting.empty()) return std::nullopt;
  in.connection.run(
      "UPDATE jobs SET state = 'running', worker = ?, lease_until = ?, fence = fence + 1, attempt = attempt + 1, "
      "started_at = ? WHERE id = ?",
      worker, steady_now + lease_ms, in.clock.utc_ms(), waiting.front());
  const auto claimed = job_at(in.connection, waiting.front());
  if (!claimed) return tl::unexpected(claimed.error());
  follow_job(in, *claimed, JobState::kRunning, std::nullopt);
  add_event(in, "job.running", claimed->row.id, "worker");
  return claimed->row;
}

Result<void> heartbeat(const Write& in, const LeaseToken& lease, std::int64_t lease_ms, double progress,
                       std::string_view progress_note) {
  const auto job = leased_job(in.connection, lease);
  if (!job) return tl::unexpected(job.error());
  in.connection.run("UPDATE jobs SET lease_until = ?, progress = ?, progress_note = ? WHERE seq = ?",
                    in.clock.steady_ms() + lease_ms, progress, progress_note, job->seq);
  if (job->row.progress != progress || job->row.progress_note != progress_note) {
    add_event(in, "job.progress", lease.job_id, "worker",
              dump_json({{"progress", progress}, {"note", std::string(progress_note)}}));
  }
  return {};
}

Result<AnalysisRow> finish(const Write& in, const LeaseToken& lease, const NewAnalysis& analysis,
                           std::string_view body_zstd, std::string_view residuals_zstd) {
  const auto job = leased_job(in.connection, lease);
  if (!job) return tl::unexpected(job.error());
  insert_analysis(in, *job, analysis, body_zstd, residuals_zstd);
  // What was asked later was asked knowing more, a newer reference, and stays shown when it was done sooner.
  const auto newest = newest_analysis(in.connection, job->row.submission_id);
  if (!newest) return newest;
  if (newest->job_id == job->row.id) show_summary(in, *job, analysis.summary);
  in.connection.run("UPDATE jobs SET progress = 1, progress_note = '' WHERE seq = ?", job->seq);
  end_job(in, *job, JobState::kDone, std::nullopt, "worker");
  auto stored = analysis_of_job(in.connection, job->row.id);
  if (stored)
    add_event(in, "analysis.stored", stored->id, "worker", dump_json({{"submission", stored->submission_id}}));
  return stored;
}

Result<JobRow> end_attempt(const Write& in, const LeaseToken& lease, AttemptEnd end, std::string_view problem_json) {
  const auto at = leased_job(in.connection, lease);
  if (!at) return tl::unexpected(at.error());
  apply_step(in, *at, end, problem_json);
  return job(in.connection, lease.job_id);
}

Result<JobRow> cancel(const Write& in, std::string_view job_id, std::string_view actor) {
  const auto at = job_at(in.connection, job_id);
  if (!at) return tl::unexpected(at.error());
  if (is_final(at->row.state)) {
    return fail("not_cancellable", fmt::format("the job {} has ended: it is {}", job_id, to_text(at->row.state)));
  }
  end_job(in, *at, JobState::kCancelled, std::nullopt, actor);
  return job(in.connection, job_id);
}

Result<int> expire_leases(const Write& in) {
  const auto expired = ids(
      in.connection.query("SELECT id FROM jobs WHERE state = 'running' AND lease_until <= ?", in.clock.steady_ms()));
  for (const std::string& id : expired) {
    const auto at = job_at(in.connection, id);
    if (!at) return tl::unexpected(at.error());
    apply_step(in, *at, AttemptEnd::kCrash,
               dump_json({{"code", "worker_lost"}, {"detail", "the worker that ran this job stopped answering"}}));
  }
  return static_cast<int>(expired.size());
}

Result<int> release_dead_leases(const Write& in) {
  const auto held = ids(in.connection.query("SELECT id FROM jobs WHERE state = 'running'"));
  for (const std::string& id : held) {
    const auto at = job_at(in.connection, id);
    if (!at) return tl::unexpected(at.error());
    apply_step(in, *at, AttemptEnd::kReturned, "");
  }
  // The steady clock may have started again with the machine: no backoff outlives the server that set it.
  in.connection.run("UPDATE jobs SET not_before = 0 WHERE state = 'queued' AND not_before <> 0");
  return static_cast<int>(held.size());
}

Result<QueueStats> queue_stats(Connection& connection) {
  QueueStats stats;
  for (const JobState state : kJobStates) stats.jobs[state] = 0;
  Query counts = connection.query("SELECT state, jobs FROM job_counts");
  while (counts.next()) {
    const JobState state = read_state(counts);
    stats.jobs[state] = counts.integer();
  }
  Query oldest = connection.query("SELECT min(created_at) FROM jobs WHERE state = 'queued'");
  if (oldest.next()) stats.oldest_queued_at = oldest.maybe_integer();
  return stats;
}

}  // namespace valvetriage::sqlite
