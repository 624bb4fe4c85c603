#include "server/store/blob_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <utility>

#include "server/store/id.h"
#include "server/wire/sha256.h"

namespace valvetriage {
namespace {

constexpr unsigned kStoredMode = 0440;
/// Longer than any upload lasts: a younger blob may still get its row.
constexpr std::int64_t kOrphanAgeMs = 24 * 3600 * std::int64_t{1000};
constexpr std::size_t kPieceBytes = 1 << 16;

std::string incoming_of(const std::string& data_dir) {
  return data_dir + "/incoming";
}
std::string blobs_of(const std::string& data_dir) {
  return data_dir + "/blobs";
}
std::string orphans_of(const std::string& data_dir) {
  return data_dir + "/orphans";
}
std::string identity_of(const std::string& data_dir) {
  return data_dir + "/store-id";
}
std::string shard_of(const std::string& data_dir, std::string_view sha256) {
  return fmt::format("{}/{}", blobs_of(data_dir), sha256.substr(0, 2));
}

/// Calls `take` with each piece of the file, until it returns false.
template <typename Take>
Result<void> read_pieces(FileSystem& files, const std::string& path, const Take& take) {
  const auto fd = files.open_read(path);
  if (!fd) return tl::unexpected(fd.error());
  std::array<char, kPieceBytes> piece;
  Result<std::size_t> got = 0;
  while ((got = files.read(*fd, piece.data(), piece.size())) && *got > 0) {
    if (!take(std::string_view(piece.data(), *got))) break;
  }
  files.close(*fd);
  if (!got) return tl::unexpected(got.error());
  return {};
}

auto appending_to(std::string& bytes) {
  return [&bytes](std::string_view piece) {
    bytes += piece;
    return true;
  };
}

tl::unexpected<Error> mismatch(const std::string& what) {
  return fail("store_mismatch",
              what + ": is every disk mounted, and are --data-dir and --database the ones that go together?");
}

/// A folder of ours that is gone is nothing that a caller asked for and there is none of.
Error our_fault(Error error) {
  if (error.code == "not_found") error.code = "io_error";
  return error;
}

Error damaged(std::string_view sha256) {
  return Error{.code = "blob_damaged",
               .message = fmt::format("the stored bytes of {} no longer have this hash", sha256)};
}

}  // namespace

struct BlobWriter::State {
  BlobStore& store;
  FileSystem& files;
  std::string path;
  int fd;
  std::int64_t max_bytes;
  std::int64_t size = 0;
  Sha256 hash{};
  bool renamed = false;

  ~State() {
    if (fd >= 0) files.close(fd);
    if (!renamed) (void)files.remove(path);  // what stays behind is swept at the next start
  }
};

BlobWriter::BlobWriter(std::unique_ptr<State> state) : state_(std::move(state)) {}
BlobWriter::BlobWriter(BlobWriter&&) noexcept = default;
BlobWriter::~BlobWriter() = default;

Result<void> BlobWriter::write(std::string_view bytes) {
  if (static_cast<std::int64_t>(bytes.size()) > state_->max_bytes - state_->size) {
    return fail("too_large", fmt::format("the upload is larger than {} bytes when expanded", state_->max_bytes));
  }
  if (auto written = state_->files.write(state_->fd, bytes); !written) return written;
  state_->hash.update(bytes);
  state_->size += static_cast<std::int64_t>(bytes.size());
  return {};
}

Result<StoredBlob> BlobWriter::commit() {
  FileSystem& files = state_->files;
  const std::string sha256 = state_->hash.hex();
  const std::string stored = state_->store.path_of(sha256);
  return files.set_mode(state_->fd, kStoredMode)
      .and_then([&] { return files.sync(state_->fd); })
      .and_then([&] { return state_->store.ensure_shard(sha256); })
      .and_then([&] { return files.rename(state_->path, stored); })
      .and_then([&] {
        state_->renamed = true;
        return files.sync_directory(stored.substr(0, stored.rfind('/')));
      })
      .map([&] { return StoredBlob(sha256, state_->size); })
      .map_error(our_fault);
}

BlobStore::BlobStore(std::string data_dir, FileSystem& files, const Clock& clock)
    : data_dir_(std::move(data_dir)), files_(files), clock_(clock) {}

Result<std::unique_ptr<BlobStore>> BlobStore::open(const std::string& data_dir, FileSystem& files, const Clock& clock) {
  if (const auto made = files.make_directory(data_dir); !made) return tl::unexpected(made.error());
  for (const std::string& folder : {incoming_of(data_dir), blobs_of(data_dir)}) {
    if (const auto made = files.make_directory(folder); !made) return tl::unexpected(made.error());
  }
  if (const auto synced = files.sync_directory(data_dir); !synced) return tl::unexpected(synced.error());
  return std::unique_ptr<BlobStore>(new BlobStore(data_dir, files, clock));
}

Result<BlobWriter> BlobStore::begin(std::int64_t max_bytes) {
  const std::string path = fmt::format("{}/{}", incoming_of(data_dir_), random_name());
  const auto fd = files_.create(path).map_error(our_fault);
  if (!fd) return tl::unexpected(fd.error());
  return BlobWriter(std::unique_ptr<BlobWriter::State>(new BlobWriter::State{*this, files_, path, *fd, max_bytes}));
}

/// The first time in this process the shard's own name is synced even where the folder was there: an earlier server may
/// have died between making and syncing it.
Result<void> BlobStore::ensure_shard(std::string_view sha256) {
  std::atomic<bool>& durable =
      shard_is_durable_[static_cast<std::size_t>(std::stoi(std::string(sha256.substr(0, 2)), nullptr, 16))];
  if (durable) return {};
  if (const auto made = files_.make_directory(shard_of(data_dir_, sha256)); !made) return tl::unexpected(made.error());
  if (auto synced = files_.sync_directory(blobs_of(data_dir_)); !synced) return synced;
  durable = true;
  return {};
}

std::string BlobStore::path_of(std::string_view sha256) const {
  return fmt::format("{}/{}", shard_of(data_dir_, sha256), sha256);
}

Result<std::string> BlobStore::read(std::string_view sha256) const {
  std::string bytes;
  const auto done = read_pieces(files_, path_of(sha256), appending_to(bytes));
  if (!done) return tl::unexpected(done.error());
  if (sha256_hex(bytes) != sha256) return tl::unexpected(damaged(sha256));
  return bytes;
}

Result<void> BlobStore::verify(std::string_view sha256, const std::function<bool()>& keep_going) const {
  Sha256 hash;
  bool interrupted = false;
  const auto done = read_pieces(files_, path_of(sha256), [&](std::string_view piece) {
    hash.update(piece);
    interrupted = !keep_going();
    return !interrupted;
  });
  if (!done) return done;
  if (interrupted) return fail("interrupted", "the stored bytes were not read to their end");
  if (hash.hex() != sha256) return tl::unexpected(damaged(sha256));
  return {};
}

Result<std::int64_t> BlobStore::free_bytes() const {
  return files_.free_bytes(data_dir_);
}

Result<std::vector<std::string>> BlobStore::list() const {
  std::vector<std::string> names;
  const auto shards = files_.list(blobs_of(data_dir_));
  if (!shards) return tl::unexpected(shards.error());
  for (const DirectoryEntry& shard : *shards) {
    const auto blobs = files_.list(fmt::format("{}/{}", blobs_of(data_dir_), shard.name));
    if (!blobs) return tl::unexpected(blobs.error());
    for (const DirectoryEntry& blob : *blobs) names.push_back(blob.name);
  }
  std::sort(names.begin(), names.end());
  return names;
}

Result<bool> BlobStore::is_claimed() const {
  return files_.exists(identity_of(data_dir_));
}

Result<void> BlobStore::adopt(Store& store) {
  return store.identity().and_then([&](const std::string& identity) { return write_identity(identity); });
}

Result<void> BlobStore::belong_to(Store& store) {
  const auto claimed = is_claimed();
  if (!claimed) return tl::unexpected(claimed.error());
  if (!*claimed) {
    return check_content(store).and_then([&] { return adopt(store); });
  }
  const auto identity = store.identity();
  if (!identity) return tl::unexpected(identity.error());
  std::string written;
  if (const auto read = read_pieces(files_, identity_of(data_dir_), appending_to(written)); !read) return read;
  if (written == *identity) return {};
  return mismatch(
      fmt::format("the recordings in {} belong to another database, as {} says", data_dir_, identity_of(data_dir_)));
}

/// A folder that does not say whose it is: new, or of a version that did not write it.
Result<void> BlobStore::check_content(Store& store) const {
  const auto blobs = list();
  if (!blobs) return tl::unexpected(blobs.error());
  const auto named = store.referenced_blobs("", 1);
  if (!named) return tl::unexpected(named.error());
  for (const std::string& blob : *blobs) {
    const auto referenced = store.blob_is_referenced(blob);
    if (!referenced) return tl::unexpected(referenced.error());
    if (*referenced) return {};
  }
  if (!blobs->empty()) {
    return mismatch(fmt::format("the database knows none of the {} recordings in {}", blobs->size(), data_dir_));
  }
  if (named->empty()) return {};
  return mismatch(fmt::format("none of the recordings that the database names is in {}", data_dir_));
}

Result<void> BlobStore::write_identity(const std::string& identity) {
  const std::string temporary = fmt::format("{}/{}", incoming_of(data_dir_), random_name());
  const auto fd = files_.create(temporary);
  if (!fd) return tl::unexpected(fd.error());
  const auto written = files_.write(*fd, identity).and_then([&] { return files_.sync(*fd); });
  files_.close(*fd);
  if (!written) return written;
  return files_.rename(temporary, identity_of(data_dir_)).and_then([&] { return files_.sync_directory(data_dir_); });
}

Result<int> BlobStore::sweep(Store& store) {
  int removed = 0;
  const auto incoming = files_.list(incoming_of(data_dir_));
  if (!incoming) return tl::unexpected(incoming.error());
  for (const DirectoryEntry& entry : *incoming) {
    if (files_.remove(fmt::format("{}/{}", incoming_of(data_dir_), entry.name))) ++removed;
  }
  const auto shards = files_.list(blobs_of(data_dir_));
  if (!shards) return tl::unexpected(shards.error());
  for (const DirectoryEntry& shard : *shards) {
    const auto blobs = files_.list(fmt::format("{}/{}", blobs_of(data_dir_), shard.name));
    if (!blobs) return tl::unexpected(blobs.error());
    for (const DirectoryEntry& blob : *blobs) {
      if (clock_.utc_ms() - blob.modified_ms < kOrphanAgeMs) continue;
      const auto referenced = store.blob_is_referenced(blob.name);
      if (!referenced) return tl::unexpected(referenced.error());
      if (*referenced) continue;
      if (const auto made = files_.make_directory(orphans_of(data_dir_)); !made) return tl::unexpected(made.error());
      if (files_.rename(path_of(blob.name), fmt::format("{}/{}", orphans_of(data_dir_), blob.name))) ++removed;
    }
  }
  return removed;
}

}  // namespace valvetriage
