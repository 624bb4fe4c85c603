#include <fmt/format.h>

#include <memory>

#include "server/store/id.h"
#include "server/store/sqlite/operations.h"
#include "server/store/sqlite/rows.h"

namespace valvetriage::sqlite {
namespace {

constexpr std::string_view kAnalysisColumns =
    "a.id, s.id, a.job_id, a.created_at, a.engine_version, a.settings_sha256, a.result_sha256, a.verdict, a.reason, "
    "a.action, a.conclusion, a.top_cause, a.top_cause_probability, a.errors, a.features, "
    "a.causes";

AnalysisRow read_analysis(Query& query) {
  AnalysisRow row;
  row.id = query.text();
  row.submission_id = query.text();
  row.job_id = query.text();
  row.created_at = query.integer();
  row.engine_version = query.text();
  row.settings_sha256 = query.text();
  row.result_sha256 = query.text();
  row.summary = read_summary(query);
  return row;
}

constexpr std::string_view kDocumentColumns = "kind, valve_type, version, sha256, created_at, created_by";

DocumentRow read_document(Query& query) {
  DocumentRow row;
  row.kind = static_cast<DocumentKind>(query.integer());
  row.valve_type = query.text();
  row.version = static_cast<int>(query.integer());
  row.sha256 = query.text();
  row.created_at = query.integer();
  row.created_by = query.text();
  return row;
}

std::string_view name_of(DocumentKind kind) {
  return kind == DocumentKind::kReference ? "reference" : "rule base";
}

std::string joined(const std::vector<std::string>& words) {
  return fmt::format("{}", fmt::join(words, " "));
}

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> words;
  for (std::size_t from = 0; from < text.size();) {
    const std::size_t to = std::min(text.find(' ', from), text.size());
    words.push_back(text.substr(from, to - from));
    from = to + 1;
  }
  return words;
}

constexpr std::string_view kTokenColumns = "id, name, scopes, created_at, revoked_at";

TokenRow read_token(Query& query) {
  TokenRow row;
  row.id = query.text();
  row.name = query.text();
  row.scopes = split(query.text());
  row.created_at = query.integer();
  row.revoked_at = query.maybe_integer();
  return row;
}

/// Adds a sentence for each row the statement gives: its first column.
void collect(Connection& connection, std::string_view sql, std::string_view sentence,
             std::vector<std::string>& damages) {
  Query query = connection.query(sql);
  while (query.next()) damages.push_back(fmt::format("{}: {}", sentence, query.text()));
}

std::vector<FindingRow> read_findings(Query& query) {
  std::vector<FindingRow> rows;
  while (query.next()) {
    FindingRow row;
    row.id = query.text();
    row.serial = query.text();
    row.cause = query.text();
    row.found_by = query.text();
    row.found_at = query.integer();
    row.note = query.text();
    row.created_at = query.integer();
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace

Result<std::vector<AnalysisRow>> analyses_of(Connection& connection, std::string_view submission_id) {
  static const std::string sql = fmt::format(
      "SELECT {} FROM analyses a JOIN submissions s ON s.seq = a.submission_seq JOIN jobs j ON j.id = a.job_id "
      "WHERE s.seq = ? ORDER BY j.seq DESC",
      kAnalysisColumns);
  const auto seq = submission_seq(connection, submission_id);
  if (!seq) return tl::unexpected(seq.error());
  Query query = connection.query(sql, *seq);
  std::vector<AnalysisRow> rows;
  while (query.next()) rows.push_back(read_analysis(query));
  return rows;
}

Result<AnalysisRow> newest_analysis(Connection& connection, std::string_view submission_id) {
  static const std::string sql = fmt::format(
      "SELECT {} FROM analyses a JOIN submissions s ON s.seq = a.submission_seq JOIN jobs j ON j.id = a.job_id "
      "WHERE s.seq = ? ORDER BY j.seq DESC LIMIT 1",
      kAnalysisColumns);
  const auto seq = submission_seq(connection, submission_id);
  if (!seq) return tl::unexpected(seq.error());
  Query query = connection.query(sql, *seq);
  if (!query.next()) return fail("not_found", fmt::format("there is no analysis of '{}' yet", submission_id));
  return read_analysis(query);
}

Result<AnalysisRow> analysis_of_job(Connection& connection, std::string_view job_id) {
  static const std::string sql = fmt::format(
      "SELECT {} FROM analyses a JOIN submissions s ON s.seq = a.submission_seq WHERE a.job_id = ?", kAnalysisColumns);
  Query query = connection.query(sql, job_id);
  if (!query.next()) return fail("not_found", fmt::format("there is no analysis of the job '{}'", job_id));
  return read_analysis(query);
}

Result<std::string> analysis_body_zstd(Connection& connection, std::string_view analysis_id) {
  Query query = connection.query(
      "SELECT b.body FROM analyses a JOIN analysis_bodies b ON b.analysis_seq = a.seq WHERE a.id = ?", analysis_id);
  if (!query.next()) return fail("not_found", fmt::format("there is no analysis '{}'", analysis_id));
  return query.text();
}

Result<std::string> newest_residuals_zstd(Connection& connection, std::string_view submission_id) {
  Query query = connection.query(
      "SELECT r.residuals FROM submissions s JOIN analyses a ON a.submission_seq = s.seq "
      "JOIN jobs j ON j.id = a.job_id LEFT JOIN analysis_residuals r ON r.analysis_seq = a.seq "
      "WHERE s.id = ? ORDER BY j.seq DESC LIMIT 1",
      submission_id);
  if (!query.next()) return fail("not_found", fmt::format("there is no analysis of '{}' yet", submission_id));
  return query.text();
}

Result<DocumentRow> add_document(const Write& in, DocumentKind kind, std::string_view valve_type,
                                 std::string_view sha256, std::string_view body_zstd, std::string_view actor) {
  const auto newest = document(in.connection, kind, valve_type, std::nullopt);
  if (newest && newest->row.sha256 == sha256) return newest->row;
  DocumentRow row;
  row.kind = kind;
  row.valve_type = valve_type;
  row.version = newest ? newest->row.version + 1 : 1;
  row.sha256 = sha256;
  row.created_at = in.clock.utc_ms();
  row.created_by = actor;
  in.connection.run(
      "INSERT INTO documents (kind, valve_type, version, sha256, created_at, created_by, body) VALUES (?, ?, ?, ?, ?, "
      "?, ?)",
      static_cast<int>(kind), valve_type, row.version, sha256, row.created_at, actor, Blob{body_zstd});
  add_event(in, kind == DocumentKind::kReference ? "reference.added" : "rule_base.added", valve_type, actor,
            fmt::format(R"({{"version":{}}})", row.version));
  return row;
}

Result<StoredDocument> document(Connection& connection, DocumentKind kind, std::string_view valve_type,
                                std::optional<int> version) {
  static const std::string sql = fmt::format(
      "SELECT {}, body FROM documents WHERE kind = ?1 AND valve_type = ?2 AND version = coalesce(?3, "
      "(SELECT max(version) FROM documents WHERE kind = ?1 AND valve_type = ?2))",
      kDocumentColumns);
  Query query = connection.query(sql, static_cast<int>(kind), valve_type, version);
  if (!query.next()) {
    return fail("not_found", version ? fmt::format("there is no version {} of the {} of valve type '{}'", *version,
                                                   name_of(kind), valve_type)
                                     : fmt::format("there is no {} of valve type '{}'", name_of(kind), valve_type));
  }
  StoredDocument stored{.row = read_document(query), .body_zstd = {}};
  stored.body_zstd = query.text();
  return stored;
}

Result<std::vector<DocumentRow>> list_documents(Connection& connection, DocumentKind kind,
                                                std::string_view valve_type) {
  static const std::string sql =
      fmt::format("SELECT {} FROM documents WHERE kind = ? AND valve_type = ? ORDER BY version DESC", kDocumentColumns);
  Query query = connection.query(sql, static_cast<int>(kind), valve_type);
  std::vector<DocumentRow> rows;
  while (query.next()) rows.push_back(read_document(query));
  return rows;
}

Result<FindingRow> add_finding(const Write& in, const NewFinding& finding) {
  const TimestampMs now = in.clock.utc_ms();
  FindingRow row{.id = new_id("fnd_", now),
                 .serial = finding.serial,
                 .cause = finding.cause,
                 .found_by = finding.found_by,
                 .found_at = finding.found_at.value_or(now),
                 .note = finding.note,
                 .created_at = now};
  in.connection.run(
      "INSERT INTO findings (id, serial, cause, found_by, found_at, note, created_at) VALUES (?, ?, ?, ?, ?, ?, ?)",
      row.id, row.serial, row.cause, row.found_by, row.found_at, row.note, row.created_at);
  add_event(in, "finding.added", row.id, finding.actor);
  return row;
}

Result<std::vector<FindingRow>> findings(Connection& connection, std::string_view serial) {
  Query query = connection.query(
      "SELECT id, serial, cause, found_by, found_at, note, created_at FROM findings WHERE serial = ? ORDER BY seq",
      serial);
  return read_findings(query);
}

Result<std::vector<FindingRow>> newest_findings(Connection& connection, int limit) {
  Query query = connection.query(
      "SELECT id, serial, cause, found_by, found_at, note, created_at FROM findings ORDER BY seq DESC LIMIT ?", limit);
  return read_findings(query);
}

Result<TokenRow> add_token(const Write& in, const NewToken& token) {
  const TimestampMs now = in.clock.utc_ms();
  TokenRow row{
      .id = new_id("tok_", now), .name = token.name, .scopes = token.scopes, .created_at = now, .revoked_at = {}};
  in.connection.run("INSERT INTO tokens (id, name, secret_sha256, scopes, created_at) VALUES (?, ?, ?, ?, ?)", row.id,
                    row.name, token.secret_sha256, joined(row.scopes), row.created_at);
  add_event(in, "token.added", row.id, token.actor);
  return row;
}

Result<TokenRow> token_by_secret(Connection& connection, std::string_view secret_sha256) {
  static const std::string sql =
      fmt::format("SELECT {} FROM tokens WHERE secret_sha256 = ? AND revoked_at IS NULL", kTokenColumns);
  Query query = connection.query(sql, secret_sha256);
  if (!query.next()) return fail("not_found", "there is no such token");
  return read_token(query);
}

Result<std::vector<TokenRow>> list_tokens(Connection& connection) {
  static const std::string sql = fmt::format("SELECT {} FROM tokens ORDER BY seq", kTokenColumns);
  Query query = connection.query(sql);
  std::vector<TokenRow> rows;
  while (query.next()) rows.push_back(read_token(query));
  return rows;
}

Result<void> revoke_token(const Write& in, std::string_view id, std::string_view actor) {
  const int revoked =
      in.connection.run("UPDATE tokens SET revoked_at = ? WHERE id = ? AND revoked_at IS NULL", in.clock.utc_ms(), id);
  if (revoked == 0) return fail("not_found", fmt::format("there is no token '{}' that is not revoked", id));
  add_event(in, "token.revoked", id, actor);
  return {};
}

Result<std::int64_t> newest_event(Connection& connection) {
  Query query = connection.query("SELECT cursor FROM events ORDER BY cursor DESC LIMIT 1");
  return query.next() ? query.integer() : 0;
}

Result<std::vector<EventRow>> events_after(Connection& connection, std::int64_t cursor, int limit) {
  if (limit < 1 || limit > kMaxPageLimit) {
    return fail("invalid_limit", fmt::format("limit is {}, it must be 1 to {}", limit, kMaxPageLimit));
  }
  Query query = connection.query(
      "SELECT cursor, at, kind, subject, actor, detail FROM events WHERE cursor > ? ORDER BY cursor LIMIT ?", cursor,
      limit);
  std::vector<EventRow> rows;
  while (query.next()) {
    EventRow row;
    row.cursor = query.integer();
    row.at = query.integer();
    row.kind = query.text();
    row.subject = query.text();
    row.actor = query.text();
    row.detail_json = query.text();
    rows.push_back(std::move(row));
  }
  return rows;
}

Result<std::string> identity(Connection& connection) {
  Query query = connection.query("SELECT id FROM store_identity");
  if (!query.next()) return fail("store_broken", "the database does not say which one it is");
  return query.text();
}

Result<bool> blob_is_referenced(Connection& connection, std::string_view sha256) {
  return connection.query("SELECT 1 FROM recordings WHERE sha256 = ? LIMIT 1", sha256).next();
}

Result<std::vector<std::string>> referenced_blobs(Connection& connection, std::string_view after, int limit) {
  Query query =
      connection.query("SELECT DISTINCT sha256 FROM recordings WHERE sha256 > ? ORDER BY sha256 LIMIT ?", after, limit);
  std::vector<std::string> names;
  while (query.next()) names.push_back(query.text());
  return names;
}

Result<std::vector<std::string>> check(Connection& connection) {
  std::vector<std::string> damages;
  collect(connection, "SELECT integrity_check FROM pragma_integrity_check WHERE integrity_check <> 'ok'",
          "the database is damaged", damages);
  collect(connection, "SELECT DISTINCT \"table\" FROM pragma_foreign_key_check", "rows name others that are missing",
          damages);
  collect(
      connection,
      "SELECT j.id FROM jobs j LEFT JOIN analyses a ON a.job_id = j.id WHERE (j.state = 'done') <> (a.id IS NOT NULL)",
      "a job and its result disagree", damages);
  // Rows of one side that the other lacks, so that a count that is gone is found as a wrong one is.
  collect(connection,
          "WITH counted AS (SELECT state, count(*) AS jobs FROM jobs GROUP BY state), "
          "kept AS (SELECT state, jobs FROM job_counts WHERE jobs <> 0) "
          "SELECT state FROM (SELECT * FROM counted EXCEPT SELECT * FROM kept) UNION "
          "SELECT state FROM (SELECT * FROM kept EXCEPT SELECT * FROM counted)",
          "jobs are miscounted", damages);
  collect(connection,
          "WITH counted AS (SELECT lot, result_seq IS NOT NULL AS analysed, verdict, count(*) AS valves "
          "FROM lot_valves GROUP BY 1, 2, 3), "
          "kept AS (SELECT lot, analysed, verdict, valves FROM lot_counts WHERE valves <> 0) "
          "SELECT lot FROM (SELECT * FROM counted EXCEPT SELECT * FROM kept) UNION "
          "SELECT lot FROM (SELECT * FROM kept EXCEPT SELECT * FROM counted)",
          "a lot's valves are miscounted", damages);
  collect(connection, "SELECT DISTINCT lot FROM lot_valves WHERE lot NOT IN (SELECT lot FROM lots)",
          "a lot has valves and no row of its own", damages);
  collect(connection,
          "SELECT s.id FROM submissions s WHERE "
          "(SELECT count(DISTINCT value ->> 0) FROM json_each(s.causes)) <> "
          "(SELECT count(*) FROM submission_causes c WHERE c.submission_seq = s.seq)",
          "a result's causes are not listed", damages);
  return damages;
}

Result<void> backup(Connection& connection, const std::string& file) {
  make_closed_to_others(file);
  sqlite3* target = nullptr;
  const int flags = SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_EXRESCODE;
  int code = sqlite3_open_v2(file.c_str(), &target, flags, nullptr);
  const std::unique_ptr<sqlite3, int (*)(sqlite3*)> owner(target, sqlite3_close);
  if (code != SQLITE_OK) throw SqliteError(code, fmt::format("cannot write {}: {}", file, sqlite3_errstr(code)));
  sqlite3_busy_timeout(target, kBusyTimeoutMs);
  // All pages in one step: one snapshot of the log, that no writer can disturb and that disturbs no writer.
  sqlite3_backup* copy = sqlite3_backup_init(target, "main", connection.handle(), "main");
  if (!copy)
    throw SqliteError(sqlite3_extended_errcode(target),
                      fmt::format("cannot write {}: {}", file, sqlite3_errmsg(target)));
  const int stepped = sqlite3_backup_step(copy, -1);
  code = sqlite3_backup_finish(copy);
  // A database that is busy or locked is no error of the backup's own: not done is not written.
  if (code == SQLITE_OK && stepped != SQLITE_DONE) {
    throw SqliteError(stepped, fmt::format("cannot write {}: {}", file, sqlite3_errstr(stepped)));
  }
  // Without a log beside it the copy is one file, readable from anywhere.
  if (code == SQLITE_OK) code = sqlite3_exec(target, "PRAGMA journal_mode = DELETE", nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) throw SqliteError(code, fmt::format("cannot write {}: {}", file, sqlite3_errmsg(target)));
  return {};
}

}  // namespace valvetriage::sqlite
