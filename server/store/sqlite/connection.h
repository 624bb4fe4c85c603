#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "core/result.h"

namespace valvetriage::sqlite {

/// What SQLite reported. Thrown inside this folder only; the doors of the writer lane and of the reader pool turn it
/// into an Error, so that a dozen statements in a row read as what they do.
class SqliteError : public std::runtime_error {
 public:
  SqliteError(int code, const std::string& what) : std::runtime_error(what), code_(code) {}
  int code() const { return code_; }  ///< extended result code

 private:
  int code_;
};

/// The Error a caller of the store sees: `no_space`, `store_busy` or `store_broken`.
Error to_error(const SqliteError& error);

/// Bytes, as opposed to text.
struct Blob {
  std::string_view bytes;
};

class Connection;

/// One run of a prepared statement: its parameters bound in order, its rows read in order of their columns. Goes back
/// to the connection's cache when it ends.
class Query {
 public:
  ~Query();
  Query(Query&& other) noexcept
      : database_(other.database_),
        statement_(std::exchange(other.statement_, nullptr)),
        parameter_(other.parameter_),
        column_(other.column_) {}
  Query& operator=(Query&&) = delete;

  /// On to the next row; false when there is none.
  bool next();

  // The next column of the row.
  std::int64_t integer() { return sqlite3_column_int64(statement_, column_++); }
  double real() { return sqlite3_column_double(statement_, column_++); }
  std::string text();
  std::optional<std::int64_t> maybe_integer();
  std::optional<double> maybe_real();
  std::optional<std::string> maybe_text();

  void bind(std::int64_t value);
  void bind(int value) { bind(std::int64_t{value}); }
  void bind(bool value) { bind(std::int64_t{value}); }
  void bind(double value);
  void bind(std::string_view value);
  void bind(const std::string& value) { bind(std::string_view(value)); }
  void bind(const char* value) { bind(std::string_view(value)); }
  void bind(Blob value);
  template <typename T>
  void bind(const std::optional<T>& value) {
    if (value) {
      bind(*value);
    } else {
      bind_null();
    }
  }

 private:
  friend class Connection;
  Query(sqlite3* database, sqlite3_stmt* statement) : database_(database), statement_(statement) {}
  void bind_null();
  void check(int code) const;
  bool is_null() const { return sqlite3_column_type(statement_, column_) == SQLITE_NULL; }

  sqlite3* database_;
  sqlite3_stmt* statement_;
  int parameter_ = 0;
  int column_ = 0;
};

enum class Access { kWrite, kRead };

/// How long a statement waits for the lock of another process.
inline constexpr int kBusyTimeoutMs = 5'000;

/// Makes a database file that is not there yet, empty and closed to others than its owner and group: it will hold what
/// tokens are known by. What SQLite puts beside it has the same mode. A failure is left to whoever opens the file.
void make_closed_to_others(const std::string& file);

/// One connection with its settings and its prepared statements. One thread at a time.
class Connection {
 public:
  /// Opens the file; kWrite makes it where it is missing, closed to others. Throws SqliteError.
  Connection(const std::string& file, Access access);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  template <typename... Values>
  Query query(std::string_view sql, const Values&... values) {
    Query query(database_, prepared(sql));
    (query.bind(values), ...);
    return query;
  }

  /// Runs a statement that gives no rows; how many rows it changed.
  template <typename... Values>
  int run(std::string_view sql, const Values&... values) {
    Query statement = query(sql, values...);
    statement.next();
    return sqlite3_changes(database_);
  }

  /// The first column of the first row, which must be there.
  template <typename... Values>
  std::int64_t integer(std::string_view sql, const Values&... values) {
    Query one = query(sql, values...);
    one.next();
    return one.integer();
  }

  /// Several statements, none of which is kept prepared.
  void script(const std::string& sql);

  std::int64_t last_row() const { return sqlite3_last_insert_rowid(database_); }
  bool in_transaction() const { return sqlite3_get_autocommit(database_) == 0; }
  sqlite3* handle() const { return database_; }

 private:
  sqlite3_stmt* prepared(std::string_view sql);
  void close();

  sqlite3* database_ = nullptr;
  std::unordered_map<std::string, sqlite3_stmt*> statements_;
};

}  // namespace valvetriage::sqlite
