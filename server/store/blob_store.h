#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "server/store/clock.h"
#include "server/store/file_system.h"
#include "server/store/store.h"

namespace valvetriage {

/// A blob that is durable under its hash. Only BlobWriter::commit makes one, so no row can name bytes that are not
/// there.
class StoredBlob {
 public:
  const std::string& sha256() const { return sha256_; }
  std::int64_t size_bytes() const { return size_bytes_; }

 private:
  friend class BlobWriter;
  StoredBlob(std::string sha256, std::int64_t size_bytes) : sha256_(std::move(sha256)), size_bytes_(size_bytes) {}
  std::string sha256_;
  std::int64_t size_bytes_;
};

class BlobStore;

/// One blob on its way in: a temporary file in incoming/, hashed while it is written. Without a commit it vanishes.
/// One thread at a time.
class BlobWriter {
 public:
  BlobWriter(BlobWriter&&) noexcept;
  BlobWriter& operator=(BlobWriter&&) = delete;
  ~BlobWriter();

  /// Errors  `too_large` beyond the cap (nothing is kept), `no_space`, `io_error`
  Result<void> write(std::string_view bytes);

  /// fsync, rename to blobs/ab/<sha256>, mode 0440, fsync of the folder. The bytes are durable when it returns.
  Result<StoredBlob> commit();

 private:
  friend class BlobStore;
  struct State;
  explicit BlobWriter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Raw bytes as they were sent (expanded), each stored once under its SHA-256, never changed.
///
///   <data-dir>/store-id                  which database the recordings belong to
///   <data-dir>/incoming/<random>         on the way in
///   <data-dir>/blobs/ab/ab34...          stored, mode 0440
///   <data-dir>/orphans/ab34...           stored once, and no recording names them: whoever needs the room may delete
///   them
///
/// Thread-safe.
class BlobStore {
 public:
  /// Makes the folders where they are missing. Lives no longer than `files` and `clock`.
  static Result<std::unique_ptr<BlobStore>> open(const std::string& data_dir, FileSystem& files = posix_file_system(),
                                                 const Clock& clock = system_clock());

  /// max_bytes  cap of the expanded bytes
  Result<BlobWriter> begin(std::int64_t max_bytes);

  /// Where the blob lies, whether or not it is there.
  std::string path_of(std::string_view sha256) const;

  /// The whole blob. Errors `not_found`, `io_error`; `blob_damaged` if its bytes no longer have its hash.
  Result<std::string> read(std::string_view sha256) const;

  /// Hashes the blob as it lies there; reads in pieces and asks before each whether to go on. Errors as `read`;
  /// `interrupted`.
  Result<void> verify(
      std::string_view sha256, const std::function<bool()>& keep_going = [] { return true; }) const;

  Result<std::int64_t> free_bytes() const;

  /// Every blob there is, in order.
  Result<std::vector<std::string>> list() const;

  /// At start, before anything is swept: the folder says that it is this database's, or is told so if it is new. An
  /// empty database beside a folder of recordings is one that was not mounted, and every recording would be an orphan.
  ///
  /// Errors  `store_mismatch` the folder is another database's, or its recordings are none of this one's, or this one's
  ///         are not there; `no_space`, `io_error`
  Result<void> belong_to(Store& store);
  /// Whether the folder says that it is some database's.
  Result<bool> is_claimed() const;
  /// The folder becomes this database's, whosever it was: of a backup that is brought back.
  Result<void> adopt(Store& store);

  /// At start, before any upload, where the folder belongs to the database: removes all of incoming/, and puts blobs
  /// that no recording names and that are older than 24 h among the orphans. Returns how many files went.
  Result<int> sweep(Store& store);

 private:
  friend class BlobWriter;
  BlobStore(std::string data_dir, FileSystem& files, const Clock& clock);
  Result<void> ensure_shard(std::string_view sha256);
  Result<void> check_content(Store& store) const;
  Result<void> write_identity(const std::string& identity);

  std::string data_dir_;
  FileSystem& files_;
  const Clock& clock_;
  std::array<std::atomic<bool>, 256> shard_is_durable_{};
};

}  // namespace valvetriage
