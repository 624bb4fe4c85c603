#include "server/jobs/accept.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "server/wire/json.h"
#include "server/wire/sha256.h"

namespace valvetriage {
namespace {

Json describe(const AcceptedFile& file) {
  return {{"name", file.name},
          {"sha256", file.blob.sha256()},
          {"test", or_null(file.test)},
          {"metadata", file.metadata_json}};
}

NewRecording to_recording(const AcceptedFile& file) {
  return {.name = file.name,
          .sha256 = file.blob.sha256(),
          .size_bytes = file.blob.size_bytes(),
          .test = file.test,
          .metadata_json = file.metadata_json};
}

}  // namespace

Result<void> check_space(const BlobStore& blobs, const AcceptLimits& limits) {
  const auto free_bytes = blobs.free_bytes();
  if (!free_bytes) return tl::unexpected(free_bytes.error());
  if (*free_bytes < limits.min_free_bytes) {
    return fail("no_space",
                fmt::format("the server has {} MB of disk left and keeps {} MB free: its operator must make space",
                            *free_bytes >> 20, limits.min_free_bytes >> 20));
  }
  return {};
}

Result<void> admit(Store& store, const BlobStore& blobs, const AcceptLimits& limits) {
  if (auto space = check_space(blobs, limits); !space) return space;
  const auto stats = store.queue_stats();
  if (!stats) return tl::unexpected(stats.error());
  if (const std::int64_t queued = stats->jobs.at(JobState::kQueued); queued >= limits.max_queued_jobs) {
    return fail("overloaded", fmt::format("{} jobs are waiting already: try again later", queued));
  }
  return {};
}

int retry_after_s(std::int64_t queued_jobs, int workers, double seconds_per_job) {
  constexpr double kLongest = 300;
  const double queue_s = static_cast<double>(queued_jobs) * seconds_per_job / std::max(1, workers);
  return static_cast<int>(std::ceil(std::clamp(queue_s / 4, 1.0, kLongest)));
}

std::string request_sha256(const AcceptRequest& request) {
  const Labels& labels = request.labels;
  Json all = {{"alone", request.alone},
              {"lot", or_null(labels.lot)},
              {"serial", or_null(labels.serial)},
              {"valve_type", or_null(labels.valve_type)},
              {"condition", or_null(labels.condition)},
              {"stand", or_null(labels.stand)},
              {"options", request.options_json},
              {"files", Json::array()}};
  for (const AcceptedFile& file : request.files) all["files"].push_back(describe(file));
  return sha256_hex(dump_json(all));
}

Result<Accepted> accept_submission(Store& store, const AcceptRequest& request, const AcceptLimits& limits) {
  NewSubmission submission;
  submission.labels = request.labels;
  for (const AcceptedFile& file : request.files) submission.recordings.push_back(to_recording(file));
  submission.alone = request.alone;
  submission.options_json = request.options_json;
  submission.request_sha256 = request_sha256(request);
  submission.idempotency = request.idempotency;
  submission.actor = request.actor;
  submission.max_queued_jobs = limits.max_queued_jobs;
  return store.accept(submission);
}

}  // namespace valvetriage
