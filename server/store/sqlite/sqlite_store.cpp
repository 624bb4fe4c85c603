#include "server/store/sqlite/sqlite_store.h"

#include <fmt/format.h>

#include <filesystem>
#include <optional>
#include <utility>

#include "server/store/file_lock.h"
#include "server/store/sqlite/lanes.h"
#include "server/store/sqlite/migrate.h"
#include "server/store/sqlite/operations.h"
#include "server/store/zstd_text.h"

namespace valvetriage {
namespace {

using sqlite::Connection;
using sqlite::Write;

class SqliteStore final : public Store {
 public:
  /// Without a lock it only reads.
  SqliteStore(std::optional<FileLock> lock, std::unique_ptr<Connection> writer, const std::string& file,
              const SqliteOptions& options)
      : clock_(*options.clock), lock_(std::move(lock)), readers_(file, options.readers) {
    if (writer) writer_.emplace(std::move(writer));
  }

  Result<Accepted> accept(const NewSubmission& submission) override {
    return write([&](const Write& in) { return sqlite::accept(in, submission); });
  }

  Result<RecordingRow> recording(std::string_view id) override {
    return readers_.run([&](Connection& c) { return sqlite::recording(c, id); });
  }
  Result<SubmissionRow> submission(std::string_view id) override {
    return readers_.run([&](Connection& c) { return sqlite::submission(c, id); });
  }
  Result<std::vector<RecordingRow>> recordings_of(std::string_view submission_id) override {
    return readers_.run([&](Connection& c) {
      return sqlite::submission_seq(c, submission_id).map([&](std::int64_t seq) {
        return sqlite::recordings_at(c, seq);
      });
    });
  }
  Result<Page<RecordingRow>> list_recordings(const Filter& filter, const PageRequest& page) override {
    return readers_.run([&](Connection& c) { return sqlite::list_recordings(c, filter, page); });
  }
  Result<Page<SubmissionRow>> list_submissions(const Filter& filter, const PageRequest& page) override {
    return readers_.run([&](Connection& c) { return sqlite::list_submissions(c, filter, page); });
  }

  Result<JobRow> job(std::string_view id) override {
    return readers_.run([&](Connection& c) { return sqlite::job(c, id); });
  }
  Result<JobRow> reanalyze(std::string_view submission_id, std::string_view options_json, std::string_view actor,
                           std::int64_t max_queued_jobs) override {
    return write(
        [&](const Write& in) { return sqlite::reanalyze(in, submission_id, options_json, actor, max_queued_jobs); });
  }
  Result<std::optional<JobRow>> claim(std::string_view worker, std::int64_t lease_ms) override {
    return write([&](const Write& in) { return sqlite::claim(in, worker, lease_ms); });
  }
  Result<void> heartbeat(const LeaseToken& lease, std::int64_t lease_ms, double progress,
                         std::string_view progress_note) override {
    return write([&](const Write& in) { return sqlite::heartbeat(in, lease, lease_ms, progress, progress_note); });
  }
  Result<AnalysisRow> finish(const LeaseToken& lease, const NewAnalysis& analysis) override {
    const std::string body_zstd = compress_text(analysis.body_json);
    const std::string residuals_zstd = analysis.residuals_json.empty() ? "" : compress_text(analysis.residuals_json);
    return write([&](const Write& in) { return sqlite::finish(in, lease, analysis, body_zstd, residuals_zstd); });
  }
  Result<JobRow> end_attempt(const LeaseToken& lease, AttemptEnd end, std::string_view problem_json) override {
    return write([&](const Write& in) { return sqlite::end_attempt(in, lease, end, problem_json); });
  }
  Result<JobRow> cancel(std::string_view job_id, std::string_view actor) override {
    return write([&](const Write& in) { return sqlite::cancel(in, job_id, actor); });
  }
  Result<int> expire_leases() override {
    return write([&](const Write& in) { return sqlite::expire_leases(in); });
  }
  Result<int> release_dead_leases() override {
    return write([&](const Write& in) { return sqlite::release_dead_leases(in); });
  }
  Result<QueueStats> queue_stats() override {
    return readers_.run([](Connection& c) { return sqlite::queue_stats(c); });
  }

  Result<std::vector<AnalysisRow>> analyses_of(std::string_view submission_id) override {
    return readers_.run([&](Connection& c) { return sqlite::analyses_of(c, submission_id); });
  }
  Result<AnalysisRow> newest_analysis(std::string_view submission_id) override {
    return readers_.run([&](Connection& c) { return sqlite::newest_analysis(c, submission_id); });
  }
  Result<std::string> analysis_body(std::string_view analysis_id) override {
    return readers_.run([&](Connection& c) { return sqlite::analysis_body_zstd(c, analysis_id); })
        .and_then(expand_text);
  }
  Result<std::string> newest_residuals(std::string_view submission_id) override {
    const auto stored = readers_.run([&](Connection& c) { return sqlite::newest_residuals_zstd(c, submission_id); });
    return stored && !stored->empty() ? expand_text(*stored) : stored;
  }

  Result<DocumentRow> add_document(DocumentKind kind, std::string_view valve_type, std::string_view body_json,
                                   std::string_view sha256, std::string_view actor) override {
    const std::string body_zstd = compress_text(body_json);
    return write([&](const Write& in) { return sqlite::add_document(in, kind, valve_type, sha256, body_zstd, actor); });
  }
  Result<DocumentBody> document(DocumentKind kind, std::string_view valve_type, std::optional<int> version) override {
    const auto stored = readers_.run([&](Connection& c) { return sqlite::document(c, kind, valve_type, version); });
    if (!stored) return tl::unexpected(stored.error());
    return expand_text(stored->body_zstd).map([&](std::string body) {
      return DocumentBody{stored->row, std::move(body)};
    });
  }
  Result<std::vector<DocumentRow>> list_documents(DocumentKind kind, std::string_view valve_type) override {
    return readers_.run([&](Connection& c) { return sqlite::list_documents(c, kind, valve_type); });
  }

  Result<Page<LotRow>> list_lots(const PageRequest& page) override {
    return readers_.run([&](Connection& c) { return sqlite::list_lots(c, page); });
  }
  Result<LotRow> lot(std::string_view lot) override {
    return readers_.run([&](Connection& c) { return sqlite::lot(c, lot); });
  }
  Result<FindingRow> add_finding(const NewFinding& finding) override {
    return write([&](const Write& in) { return sqlite::add_finding(in, finding); });
  }
  Result<std::vector<FindingRow>> findings(std::string_view serial) override {
    return readers_.run([&](Connection& c) { return sqlite::findings(c, serial); });
  }
  Result<std::vector<FindingRow>> newest_findings(int limit) override {
    return readers_.run([&](Connection& c) { return sqlite::newest_findings(c, limit); });
  }

  Result<TokenRow> add_token(const NewToken& token) override {
    return write([&](const Write& in) { return sqlite::add_token(in, token); });
  }
  Result<TokenRow> token_by_secret(std::string_view secret_sha256) override {
    return readers_.run([&](Connection& c) { return sqlite::token_by_secret(c, secret_sha256); });
  }
  Result<std::vector<TokenRow>> list_tokens() override {
    return readers_.run([](Connection& c) { return sqlite::list_tokens(c); });
  }
  Result<void> revoke_token(std::string_view id, std::string_view actor) override {
    return write([&](const Write& in) { return sqlite::revoke_token(in, id, actor); });
  }

  Result<std::int64_t> newest_event() override {
    return readers_.run([&](Connection& c) { return sqlite::newest_event(c); });
  }
  Result<std::vector<EventRow>> events_after(std::int64_t cursor, int limit) override {
    return readers_.run([&](Connection& c) { return sqlite::events_after(c, cursor, limit); });
  }

  Result<void> probe() override {
    // Writing the version it has already makes a real, synced commit that changes nothing.
    return write([](const Write& in) {
      in.connection.script(fmt::format("PRAGMA user_version = {}", sqlite::schema_version(in.connection)));
      return Result<void>{};
    });
  }
  Result<std::string> identity() override {
    return readers_.run([](Connection& c) { return sqlite::identity(c); });
  }
  Result<bool> blob_is_referenced(std::string_view sha256) override {
    return readers_.run([&](Connection& c) { return sqlite::blob_is_referenced(c, sha256); });
  }
  Result<std::vector<std::string>> referenced_blobs(std::string_view after, int limit) override {
    return readers_.run([&](Connection& c) { return sqlite::referenced_blobs(c, after, limit); });
  }
  Result<std::vector<std::string>> check() override {
    return readers_.run([](Connection& c) { return sqlite::check(c); });
  }
  Result<void> backup(const std::string& file) override {
    std::error_code unreadable;
    if (std::filesystem::exists(file, unreadable))
      return fail("already_there", fmt::format("{} is there already", file));
    return readers_.run([&](Connection& c) { return sqlite::backup(c, file); });
  }

 private:
  template <typename Work>
  auto write(const Work& work) -> decltype(work(std::declval<const Write&>())) {
    if (!writer_) return fail("read_only", "the database was opened for reading only");
    return writer_->run([&](Connection& connection) { return work(Write{connection, clock_}); });
  }

  const Clock& clock_;
  std::optional<FileLock> lock_;
  // The writer's connection closes last and so folds the log into the database; readers never do.
  std::optional<sqlite::WriterLane> writer_;
  sqlite::ReaderPool readers_;
};

/// Runs what may throw SqliteError.
template <typename Work>
auto guarded(const std::string& file, const Work& work) -> decltype(work()) {
  try {
    return work();
  } catch (const sqlite::SqliteError& error) {
    Error problem = sqlite::to_error(error);
    problem.file = file;
    return tl::unexpected(problem);
  }
}

}  // namespace

Result<std::unique_ptr<Store>> open_sqlite_store(const std::string& database_file, const SqliteOptions& options) {
  return guarded(database_file, [&]() -> Result<std::unique_ptr<Store>> {
    // Whichever way its path leads there, one database has one lock.
    std::error_code unknown;
    const auto canonical = std::filesystem::weakly_canonical(database_file, unknown);
    auto lock = FileLock::take((unknown ? database_file : canonical.string()) + ".lock", "this database");
    if (!lock) return tl::unexpected(lock.error());
    auto writer = std::make_unique<Connection>(database_file, sqlite::Access::kWrite);
    if (options.migrate) {
      if (const auto migrated = sqlite::migrate(*writer); !migrated) return tl::unexpected(migrated.error());
    }
    if (const auto sound = sqlite::check_schema(*writer); !sound) return tl::unexpected(sound.error());
    return std::make_unique<SqliteStore>(std::move(*lock), std::move(writer), database_file, options);
  });
}

Result<std::unique_ptr<Store>> open_sqlite_reader(const std::string& database_file, const SqliteOptions& options) {
  return guarded(database_file, [&]() -> Result<std::unique_ptr<Store>> {
    std::error_code unreadable;
    if (!std::filesystem::exists(database_file, unreadable)) {
      return fail("not_found", fmt::format("there is no database {}", database_file));
    }
    Connection first(database_file, sqlite::Access::kRead);
    if (const auto sound = sqlite::check_schema(first); !sound) return tl::unexpected(sound.error());
    return std::make_unique<SqliteStore>(std::nullopt, nullptr, database_file, options);
  });
}

}  // namespace valvetriage
