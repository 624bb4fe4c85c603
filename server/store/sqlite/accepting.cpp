#include <fmt/format.h>

#include <algorithm>

#include "server/store/id.h"
#include "server/store/sqlite/operations.h"
#include "server/store/sqlite/rows.h"
#include "server/wire/sha256.h"

namespace valvetriage::sqlite {
namespace {

/// One hash over texts, each with its length, so that no two lists of texts run together.
std::string joint_sha256(const std::vector<std::string_view>& texts) {
  Sha256 hash;
  for (const std::string_view text : texts) hash.update(fmt::format("{}:", text.size())).update(text);
  return hash.hex();
}

/// Absent without a serial: nobody can tell then whether it is the same valve again.
std::optional<std::string> same_key(const Labels& labels, std::string_view sha256) {
  if (!labels.serial) return std::nullopt;
  return joint_sha256({labels.lot.value_or(""), *labels.serial, sha256});
}

std::optional<std::string> content_key(const NewSubmission& submission) {
  if (!submission.labels.serial) return std::nullopt;
  std::vector<std::string_view> parts;
  for (const NewRecording& recording : submission.recordings) parts.push_back(recording.sha256);
  std::sort(parts.begin(), parts.end());
  const std::string lot = submission.labels.lot.value_or("");
  parts.insert(parts.begin(), {std::string_view(lot), std::string_view(*submission.labels.serial)});
  return joint_sha256(parts);
}

/// recording_id  where only one recording of the submission is the answer
struct Answer {
  std::int64_t submission_seq = 0;
  std::optional<std::string> recording_id;
  bool created = false;
};

Result<Accepted> describe(Connection& connection, const Answer& answer, AcceptKind kind) {
  auto submission = submission_at(connection, answer.submission_seq);
  if (!submission) return tl::unexpected(submission.error());
  Accepted accepted{.kind = kind, .first_created = answer.created, .submission = *submission, .recordings = {}};
  accepted.recordings = recordings_at(connection, answer.submission_seq);
  if (answer.recording_id) {
    std::erase_if(accepted.recordings, [&](const RecordingRow& row) { return row.id != *answer.recording_id; });
  }
  return accepted;
}

/// The answer this key was given before; `idempotency_conflict` if it was for another request.
Result<std::optional<Answer>> earlier_answer(Connection& connection, const NewSubmission& submission) {
  if (!submission.idempotency) return std::nullopt;
  Query query = connection.query(
      "SELECT request_sha256, submission_seq, recording_id, created FROM idempotency WHERE principal = ? AND key = ?",
      submission.idempotency->principal, submission.idempotency->key);
  if (!query.next()) return std::nullopt;
  if (query.text() != submission.request_sha256) {
    return fail("idempotency_conflict", fmt::format("the Idempotency-Key '{}' was used before for another request",
                                                    submission.idempotency->key));
  }
  Answer answer;
  answer.submission_seq = query.integer();
  answer.recording_id = query.maybe_text();
  answer.created = query.integer() != 0;
  return answer;
}

std::optional<Answer> same_recording(Connection& connection, const NewSubmission& submission) {
  Query query = connection.query("SELECT submission_seq, id FROM recordings WHERE same_key = ?",
                                 same_key(submission.labels, submission.recordings.front().sha256));
  if (!query.next()) return std::nullopt;
  Answer answer;
  answer.submission_seq = query.integer();
  answer.recording_id = query.text();
  return answer;
}

std::optional<Answer> same_submission(Connection& connection, const NewSubmission& submission) {
  Query query = connection.query("SELECT seq FROM submissions WHERE content_key = ?", content_key(submission));
  if (!query.next()) return std::nullopt;
  return Answer{.submission_seq = query.integer(), .recording_id = {}, .created = false};
}

/// What came to nothing as it was read is read again where it is sent once more with other options, such as the names
/// of its columns; and whatever came of it where only now the type of its valve is said, without which it has no
/// reference.
Result<void> read_again(const Write& in, const NewSubmission& submission, const Answer& same) {
  Query query = in.connection.query(
      "SELECT s.state, j.options, s.valve_type IS NULL FROM submissions s JOIN jobs j ON j.id = s.job_id WHERE s.seq = "
      "?",
      same.submission_seq);
  if (!query.next()) return {};
  const JobState state = read_state(query);
  const bool is_asked_otherwise = query.text() != submission.options_json;
  const bool is_typed_now = query.integer() != 0 && submission.labels.valve_type.has_value();
  const bool came_to_nothing = is_final(state) && state != JobState::kDone;
  if (!(is_typed_now && is_final(state)) && !(is_asked_otherwise && came_to_nothing)) return {};
  in.connection.run("UPDATE submissions SET valve_type = coalesce(valve_type, ?) WHERE seq = ?",
                    submission.labels.valve_type, same.submission_seq);
  const auto job =
      enqueue(in, same.submission_seq, submission.options_json, submission.actor, submission.max_queued_jobs);
  if (!job) return tl::unexpected(job.error());
  return {};
}

void remember_answer(const Write& in, const NewSubmission& submission, const Answer& answer) {
  if (!submission.idempotency) return;
  in.connection.run("INSERT INTO idempotency VALUES (?, ?, ?, ?, ?, ?, ?)", submission.idempotency->principal,
                    submission.idempotency->key, submission.request_sha256, answer.submission_seq, answer.recording_id,
                    answer.created, in.clock.utc_ms());
}

/// The row, its job still to come.
std::int64_t insert_submission(const Write& in, const NewSubmission& submission) {
  const Labels& labels = submission.labels;
  const TimestampMs now = in.clock.utc_ms();
  in.connection.run(
      "INSERT INTO submissions (id, job_id, state, received_at, lot, serial, valve_type, condition, stand, recordings, "
      "content_key) VALUES (?, '', 'queued', ?, ?, ?, ?, ?, ?, ?, ?)",
      new_id("sub_", now), now, labels.lot, labels.serial, labels.valve_type, labels.condition, labels.stand,
      static_cast<std::int64_t>(submission.recordings.size()), content_key(submission));
  return in.connection.last_row();
}

/// Only the first recording of these bytes carries the key: a later one inside another submission is a row of its own.
std::optional<std::string> free_same_key(Connection& connection, const Labels& labels, const NewRecording& recording) {
  auto key = same_key(labels, recording.sha256);
  if (key && connection.query("SELECT 1 FROM recordings WHERE same_key = ?", key).next()) return std::nullopt;
  return key;
}

std::string insert_recording(const Write& in, std::int64_t submission_seq, const Labels& labels,
                             const NewRecording& recording, std::string_view actor) {
  const std::string id = new_id("rec_", in.clock.utc_ms());
  in.connection.run(
      "INSERT INTO recordings (id, submission_seq, name, sha256, size_bytes, test, metadata, same_key) "
      "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
      id, submission_seq, recording.name, recording.sha256, recording.size_bytes, recording.test,
      recording.metadata_json, free_same_key(in.connection, labels, recording));
  add_event(in, "recording.accepted", id, actor);
  return id;
}

void count_in_lot(const Write& in, std::int64_t submission_seq, const NewSubmission& submission) {
  if (!submission.labels.lot) return;
  const TimestampMs now = in.clock.utc_ms();
  in.connection.run(
      "INSERT INTO lots (lot, first_received_at, last_received_at, recordings, submissions) VALUES (?1, ?2, ?2, ?3, 1) "
      "ON CONFLICT (lot) DO UPDATE SET last_received_at = max(last_received_at, ?2), recordings = recordings + ?3, "
      "submissions = submissions + 1",
      submission.labels.lot, now, static_cast<std::int64_t>(submission.recordings.size()));
  in.connection.run(
      "INSERT INTO lot_valves (lot, valve) SELECT lot, coalesce('serial ' || serial, id) FROM submissions WHERE seq = "
      "? "
      "ON CONFLICT DO NOTHING",
      submission_seq);
}

Result<Answer> insert(const Write& in, const NewSubmission& submission) {
  const std::int64_t seq = insert_submission(in, submission);
  Answer answer{.submission_seq = seq, .recording_id = {}, .created = true};
  for (const NewRecording& recording : submission.recordings) {
    const std::string id = insert_recording(in, seq, submission.labels, recording, submission.actor);
    if (submission.alone) answer.recording_id = id;
  }
  count_in_lot(in, seq, submission);
  const auto job = enqueue(in, seq, submission.options_json, submission.actor, submission.max_queued_jobs);
  if (!job) return tl::unexpected(job.error());
  return answer;
}

Result<void> check_request(const NewSubmission& submission) {
  if (submission.recordings.empty()) return fail("no_files", "a submission needs at least one recording");
  if (submission.alone && submission.recordings.size() != 1) {
    return fail("too_many_files", "one recording is sent alone, several as a submission");
  }
  return {};
}

}  // namespace

void add_event(const Write& in, std::string_view kind, std::string_view subject, std::string_view actor,
               std::string_view detail_json) {
  in.connection.run("INSERT INTO events (at, kind, subject, actor, detail) VALUES (?, ?, ?, ?, ?)", in.clock.utc_ms(),
                    kind, subject, actor, detail_json);
}

Result<std::string> enqueue(const Write& in, std::int64_t submission_seq, std::string_view options_json,
                            std::string_view actor, std::int64_t max_queued_jobs) {
  Query waiting = in.connection.query("SELECT jobs FROM job_counts WHERE state = 'queued'");
  if (waiting.next() && waiting.integer() >= max_queued_jobs) {
    return fail("overloaded", fmt::format("{} jobs are waiting already: try again later", max_queued_jobs));
  }
  const TimestampMs now = in.clock.utc_ms();
  const std::string id = new_id("job_", now);
  in.connection.run(
      "INSERT INTO jobs (id, submission_seq, state, created_at, not_before, options) VALUES (?, ?, 'queued', ?, ?, ?)",
      id, submission_seq, now, in.clock.steady_ms(), options_json);
  in.connection.run(
      "UPDATE submissions SET job_id = ?, state = CASE state WHEN 'done' THEN 'done' ELSE 'queued' END, "
      "problem = NULL WHERE seq = ?",
      id, submission_seq);
  add_event(in, "job.queued", id, actor);
  return id;
}

Result<Accepted> accept(const Write& in, const NewSubmission& submission) {
  if (auto sound = check_request(submission); !sound) return tl::unexpected(sound.error());
  const auto earlier = earlier_answer(in.connection, submission);
  if (!earlier) return tl::unexpected(earlier.error());
  if (*earlier) return describe(in.connection, **earlier, AcceptKind::kReplayed);

  const auto same =
      submission.alone ? same_recording(in.connection, submission) : same_submission(in.connection, submission);
  if (same) {
    if (auto asked = read_again(in, submission, *same); !asked) return tl::unexpected(asked.error());
    remember_answer(in, submission, *same);
    return describe(in.connection, *same, AcceptKind::kDuplicate);
  }
  const auto created = insert(in, submission);
  if (!created) return tl::unexpected(created.error());
  remember_answer(in, submission, *created);
  return describe(in.connection, *created, AcceptKind::kCreated);
}

}  // namespace valvetriage::sqlite
