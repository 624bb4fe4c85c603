#pragma once

#include <span>
#include <string>
#include <string_view>

#include "core/result.h"
#include "server/store/sqlite/connection.h"

namespace valvetriage::sqlite {

/// One step of the schema: migrations/sqlite/NNNN_name.sql, built into the binary.
struct Migration {
  int version = 0;
  std::string_view name;
  std::string_view sql;
};

/// All of them, version 1, 2, ... without a gap.
std::span<const Migration> migrations();

/// The schema's version in this database; 0 for an empty one.
int schema_version(Connection& connection);

/// Brings the database to the newest of `steps`, each step one transaction; forward only. Throws SqliteError.
///
/// Returns how many steps it took.  Errors  `schema_too_new` a newer version wrote the database; nothing was touched
Result<int> migrate(Connection& connection, std::span<const Migration> steps = migrations());

/// Whether this binary can work on the database as it is. Errors  `schema_too_new`, `schema_too_old`
Result<void> check_schema(Connection& connection);

}  // namespace valvetriage::sqlite
