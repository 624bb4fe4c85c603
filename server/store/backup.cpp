#include "server/store/backup.h"

#include <fmt/format.h>

#include <filesystem>

#include "server/store/file_lock.h"
#include "server/store/sqlite/sqlite_store.h"

namespace valvetriage {
namespace {

constexpr int kBlobsAtOnce = 1000;

/// Calls `visit(sha256)` for every blob the store names; stops at the first Error.
template <typename Visit>
Result<void> for_each_blob(Store& store, const Visit& visit) {
  std::string after;
  for (;;) {
    const auto names = store.referenced_blobs(after, kBlobsAtOnce);
    if (!names) return tl::unexpected(names.error());
    if (names->empty()) return {};
    for (const std::string& sha256 : *names) {
      if (auto visited = visit(sha256); !visited) return visited;
    }
    after = names->back();
  }
}

Result<std::int64_t> copy_blob(const BlobStore& from, BlobStore& to, const std::string& sha256) {
  const auto bytes = from.read(sha256);
  if (!bytes) return tl::unexpected(bytes.error());
  auto writer = to.begin(static_cast<std::int64_t>(bytes->size()));
  if (!writer) return tl::unexpected(writer.error());
  if (const auto written = writer->write(*bytes); !written) return tl::unexpected(written.error());
  return writer->commit().map([](const StoredBlob& blob) { return blob.size_bytes(); });
}

Result<BackupReport> copy_blobs(Store& named_by, const BlobStore& from, BlobStore& to) {
  BackupReport report;
  const auto copied = for_each_blob(named_by, [&](const std::string& sha256) -> Result<void> {
    const auto bytes = copy_blob(from, to, sha256);
    if (!bytes) return tl::unexpected(bytes.error());
    ++report.blobs;
    report.bytes += *bytes;
    return {};
  });
  if (!copied) return tl::unexpected(copied.error());
  return report;
}

}  // namespace

Result<BackupReport> back_up(Store& store, const BlobStore& blobs, const std::string& folder) {
  const auto target = BlobStore::open(folder);
  if (!target) return tl::unexpected(target.error());
  const std::string database = folder + "/" + kBackupDatabase;
  if (const auto copied = store.backup(database); !copied) return tl::unexpected(copied.error());
  const auto snapshot = open_sqlite_reader(database);
  if (!snapshot) return tl::unexpected(snapshot.error());
  auto report = copy_blobs(**snapshot, blobs, **target);
  if (const auto synced = posix_file_system().sync_directory(folder); !synced) return tl::unexpected(synced.error());
  return report;
}

Result<BackupReport> restore(const std::string& folder, const std::string& database_file, const std::string& data_dir) {
  std::error_code unreadable;
  if (std::filesystem::exists(database_file, unreadable)) {
    return fail("already_there", fmt::format("there is a database at {}: restore into an empty place", database_file));
  }
  const auto snapshot = open_sqlite_reader(folder + "/" + kBackupDatabase);
  if (!snapshot) return tl::unexpected(snapshot.error());
  const auto damages = (*snapshot)->check();
  if (!damages) return tl::unexpected(damages.error());
  if (!damages->empty()) return fail("backup_damaged", damages->front());
  const auto source = BlobStore::open(folder);
  if (!source) return tl::unexpected(source.error());
  const auto target = BlobStore::open(data_dir);
  if (!target) return tl::unexpected(target.error());
  const auto lock = lock_data_folder(data_dir);
  if (!lock) return tl::unexpected(lock.error());
  auto report = copy_blobs(**snapshot, **source, **target);
  if (!report) return report;
  if (const auto copied = (*snapshot)->backup(database_file); !copied) return tl::unexpected(copied.error());
  if (const auto ours = (*target)->adopt(**snapshot); !ours) return tl::unexpected(ours.error());
  return report;
}

Result<std::vector<std::string>> check_everything(Store& store, const BlobStore& blobs) {
  auto damages = store.check();
  if (!damages) return damages;
  const auto visited = for_each_blob(store, [&](const std::string& sha256) -> Result<void> {
    if (const auto sound = blobs.verify(sha256); !sound) damages->push_back(sound.error().message);
    return {};
  });
  if (!visited) return tl::unexpected(visited.error());
  return damages;
}

}  // namespace valvetriage
