#include "server/http/stored_recording.h"

#include "core/recording/metadata.h"
#include "core/recording/prepare.h"
#include "server/jobs/reading_child.h"
#include "server/wire/read_recording.h"

namespace valvetriage::http {
namespace {

constexpr std::chrono::seconds kPatience{5};

/// A MAT file, which this process never opens itself.
Result<Recording> read_stored_mat(const Service& service, const FileToRead& file, const ReadOptions& options) {
  auto raw = read_in_child(file, WhatToRead::kAll, [&] { return !service.stopping(); });
  if (!raw && raw.error().code == "unreadable") return fail("not_available", raw.error().message);
  if (!raw) return tl::unexpected(raw.error());
  if (auto applied = apply_metadata_options(raw->metadata, options.metadata); !applied) {
    return tl::unexpected(applied.error());
  }
  return prepare_recording(std::move(*raw), options.mapping);
}

}  // namespace

Result<PlaceForWork> PlaceForWork::take(Places& places) {
  if (places.try_acquire_for(kPatience)) return PlaceForWork(&places);
  return fail("busy", "the server does as much of this already as it may at a time; try again");
}

Result<std::string> reading_options_of(Store& store, std::string_view submission_id, std::string_view newest_job_id) {
  const auto shown = store.newest_analysis(submission_id);
  if (!shown && shown.error().code != "not_found") return tl::unexpected(shown.error());
  const auto job = store.job(shown ? std::string_view(shown->job_id) : newest_job_id);
  if (!job) return tl::unexpected(job.error());
  return job->options_json;
}

Result<FileToRead> file_of(Service& service, const RecordingRow& row) {
  auto options_json = reading_options_of(service.store, row.submission_id, row.job_id);
  if (!options_json) return tl::unexpected(options_json.error());
  return FileToRead{.path = service.blobs.path_of(row.sha256),
                    .name = row.name,
                    .options_json = std::move(*options_json),
                    .test = row.test};
}

Result<Recording> read_stored_recording(Service& service, const RecordingRow& row) {
  const auto file = file_of(service, row);
  if (!file) return tl::unexpected(file.error());
  const auto options = read_options_of(*file);
  if (!options) return tl::unexpected(options.error());
  auto read = read_recording_file(file->path, *options);
  if (!read && read.error().code == "mat_not_allowed") return read_stored_mat(service, *file, *options);
  if (!read) return tl::unexpected(read.error());
  return std::move(read->recording);
}

}  // namespace valvetriage::http
