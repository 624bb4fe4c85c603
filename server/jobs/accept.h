#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "server/store/blob_store.h"
#include "server/store/store.h"

namespace valvetriage {

/// Bounds of what the service takes on.
///
/// max_queued_jobs      waiting jobs beyond which nothing more is accepted: a day's work for a small machine, and a
/// queue
///                      that a person can still look through
/// min_free_bytes       room the database needs to go on while the operator makes space
struct AcceptLimits {
  std::int64_t max_queued_jobs = 10'000;
  std::int64_t min_free_bytes = std::int64_t{512} << 20;
};

/// One file of an upload, already durable in the blob store.
struct AcceptedFile {
  std::string name{};
  StoredBlob blob;
  std::optional<std::string> test{};
  std::string metadata_json = "{}";
};

/// alone         the single recording of POST /v1/recordings
/// options_json  what the analysis is asked for (column mapping, sample rate), one JSON object
struct AcceptRequest {
  Labels labels{};
  std::vector<AcceptedFile> files{};
  bool alone = false;
  std::string options_json = "{}";
  std::optional<IdempotencyKey> idempotency{};
  std::string actor = "local";
};

/// Whether the disk keeps what it is to keep free. Errors  `no_space` (507)
Result<void> check_space(const BlobStore& blobs, const AcceptLimits& limits);

/// Before a body is read: whether there is room for it. Errors  `overloaded` (answer 503 with Retry-After
/// `retry_after_s`), `no_space` (507)
Result<void> admit(Store& store, const BlobStore& blobs, const AcceptLimits& limits = {});

/// Seconds after which a refused client should come back: a quarter of the time the queue needs, 1 to 300.
///
/// seconds_per_job  how long one job keeps a worker
int retry_after_s(std::int64_t queued_jobs, int workers, double seconds_per_job);

/// The last step of "accept, then answer": the files are durable (BlobWriter::commit), this writes the rows in one
/// transaction. When it returns a value, answer 202 (or 200); never before.
///
///   admit -> BlobStore::begin -> write ... -> commit -> accept_submission -> answer
///
/// Errors  `no_files`; `overloaded`; `idempotency_conflict`; the store's
Result<Accepted> accept_submission(Store& store, const AcceptRequest& request, const AcceptLimits& limits = {});

/// What an idempotency key is bound to: the labels, the options and the name, hash and test of every file.
std::string request_sha256(const AcceptRequest& request);

}  // namespace valvetriage
