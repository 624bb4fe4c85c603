#pragma once

#include <memory>
#include <string>

#include "server/store/store.h"

namespace valvetriage {

/// clock                 lives longer than the store
/// readers               connections that only read; a call waits for a free one
/// migrate               make the database where there is none, and bring an older one to this schema
struct SqliteOptions {
  const Clock* clock = &system_clock();
  int readers = 4;
  bool migrate = true;
};

/// Opens the database of one server: WAL, synchronous=FULL, one connection that alone writes, commits and checkpoints.
/// The file `<database_file>.lock` is held locked as long as the store lives, so that a second server is refused;
/// a lock that is let go of within a second is waited for.
///
/// Errors  `store_locked` another server has it; `schema_too_new` a newer version wrote it; `schema_too_old` it needs
///         `valvetriage migrate` (only with migrate = false); `store_broken`; `no_space`
Result<std::unique_ptr<Store>> open_sqlite_store(const std::string& database_file, const SqliteOptions& options = {});

/// The same database for reading only, also while a server has it: calls that change something fail with `read_only`.
///
/// Errors  `not_found`; `schema_too_new`; `schema_too_old`; `store_broken`
Result<std::unique_ptr<Store>> open_sqlite_reader(const std::string& database_file, const SqliteOptions& options = {});

}  // namespace valvetriage
