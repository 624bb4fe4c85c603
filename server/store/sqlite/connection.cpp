#include "server/store/sqlite/connection.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

namespace valvetriage::sqlite {
namespace {

// trusted_schema and cell_size_check: a damaged or forged file is an error, not a crash. journal_size_limit gives the
// disk back after a burst. Readers never checkpoint: two connections that write the log and reset it at the same
// instant lose committed pages in SQLite 3.7.0 to 3.51.2.
constexpr const char* kCommonSettings =
    "PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON; PRAGMA foreign_keys = ON; PRAGMA temp_store = MEMORY;";
constexpr const char* kWriterSettings =
    "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA wal_autocheckpoint = 1000;"
    "PRAGMA journal_size_limit = 67108864; PRAGMA cache_size = -65536;";
constexpr const char* kReaderSettings =
    "PRAGMA query_only = ON; PRAGMA wal_autocheckpoint = 0; PRAGMA cache_size = -16384;";

[[noreturn]] void raise(sqlite3* database, int code) {
  throw SqliteError(database ? sqlite3_extended_errcode(database) : code,
                    database ? sqlite3_errmsg(database) : sqlite3_errstr(code));
}

}  // namespace

Error to_error(const SqliteError& error) {
  switch (error.code() & 0xff) {
    case SQLITE_FULL:
      return {.code = "no_space", .message = "the disk with the database is full: make space and try again"};
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return {.code = "store_busy", .message = "the database is busy: try again"};
    default:
      return {.code = "store_broken", .message = fmt::format("the database reports: {}", error.what())};
  }
}

Query::~Query() {
  if (!statement_) return;
  sqlite3_reset(statement_);
  sqlite3_clear_bindings(statement_);
}

void Query::check(int code) const {
  if (code != SQLITE_OK) raise(database_, code);
}

bool Query::next() {
  column_ = 0;
  const int code = sqlite3_step(statement_);
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  raise(database_, code);
}

std::string Query::text() {
  const int column = column_++;
  const void* bytes = sqlite3_column_blob(statement_, column);
  const int size = sqlite3_column_bytes(statement_, column);
  return size == 0 ? std::string() : std::string(static_cast<const char*>(bytes), static_cast<std::size_t>(size));
}

std::optional<std::int64_t> Query::maybe_integer() {
  if (!is_null()) return integer();
  ++column_;
  return std::nullopt;
}

std::optional<double> Query::maybe_real() {
  if (!is_null()) return real();
  ++column_;
  return std::nullopt;
}

std::optional<std::string> Query::maybe_text() {
  if (!is_null()) return text();
  ++column_;
  return std::nullopt;
}

void Query::bind(std::int64_t value) {
  check(sqlite3_bind_int64(statement_, ++parameter_, value));
}
void Query::bind(double value) {
  check(sqlite3_bind_double(statement_, ++parameter_, value));
}
void Query::bind_null() {
  check(sqlite3_bind_null(statement_, ++parameter_));
}
void Query::bind(std::string_view value) {
  check(sqlite3_bind_text64(statement_, ++parameter_, value.data() ? value.data() : "", value.size(), SQLITE_TRANSIENT,
                            SQLITE_UTF8));
}
void Query::bind(Blob value) {
  check(sqlite3_bind_blob64(statement_, ++parameter_, value.bytes.data(), value.bytes.size(), SQLITE_TRANSIENT));
}

void make_closed_to_others(const std::string& file) {
  // Never one that is there: closing it would let go of every lock this process has on it.
  const int made = ::open(file.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0640);
  if (made >= 0) ::close(made);
}

Connection::Connection(const std::string& file, Access access) {
  if (access == Access::kWrite) make_closed_to_others(file);
  const int flags = (access == Access::kWrite ? SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE : SQLITE_OPEN_READONLY) |
                    SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE;
  try {
    if (const int code = sqlite3_open_v2(file.c_str(), &database_, flags, nullptr); code != SQLITE_OK) {
      raise(database_, code);
    }
    sqlite3_busy_timeout(database_, kBusyTimeoutMs);
    sqlite3_db_config(database_, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
    script(kCommonSettings);
    script(access == Access::kWrite ? kWriterSettings : kReaderSettings);
  } catch (...) {
    close();
    throw;
  }
}

Connection::~Connection() {
  close();
}

void Connection::close() {
  for (const auto& [sql, statement] : statements_) sqlite3_finalize(statement);
  statements_.clear();
  sqlite3_close(database_);
  database_ = nullptr;
}

void Connection::script(const std::string& sql) {
  if (const int code = sqlite3_exec(database_, sql.c_str(), nullptr, nullptr, nullptr); code != SQLITE_OK) {
    raise(database_, code);
  }
}

sqlite3_stmt* Connection::prepared(std::string_view sql) {
  sqlite3_stmt*& statement = statements_[std::string(sql)];
  if (!statement) {
    const int code = sqlite3_prepare_v3(database_, sql.data(), static_cast<int>(sql.size()), SQLITE_PREPARE_PERSISTENT,
                                        &statement, nullptr);
    if (code != SQLITE_OK) raise(database_, code);
  }
  return statement;
}

}  // namespace valvetriage::sqlite
