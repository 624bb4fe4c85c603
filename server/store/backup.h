#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/result.h"
#include "server/store/blob_store.h"
#include "server/store/store.h"

namespace valvetriage {

/// The database's file inside a backup.
inline constexpr const char* kBackupDatabase = "valvetriage.sqlite";

struct BackupReport {
  std::int64_t blobs = 0;
  std::int64_t bytes = 0;
};

/// A copy of everything into a new folder while the server works: first the database as it is at one instant, then
/// every blob it names (blobs never change, and none that is named ever goes). Every blob's hash is checked on the way.
///
/// Errors  `already_there` the folder holds a backup; `blob_damaged`, `not_found` a blob is not what its row says;
/// `no_space`
Result<BackupReport> back_up(Store& store, const BlobStore& blobs, const std::string& folder);

/// A backup back into an empty place: everything is checked before the database, last, makes it count.
///
/// Errors  `already_there` there is a database; `backup_damaged` with what is damaged; as above
Result<BackupReport> restore(const std::string& folder, const std::string& database_file, const std::string& data_dir);

/// Sentences that say what is damaged in the database or among the blobs it names; none when all is well.
Result<std::vector<std::string>> check_everything(Store& store, const BlobStore& blobs);

}  // namespace valvetriage
