#include <fmt/format.h>

#include <charconv>

#include "core/recording/columns.h"
#include "core/recording/metadata.h"
#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/problem.h"
#include "server/http/receive.h"
#include "server/http/stored_recording.h"
#include "server/http/views.h"
#include "server/jobs/reading_child.h"
#include "server/wire/json_recording.h"

namespace valvetriage::http {
namespace {

constexpr std::size_t kMaxIdempotencyKeyBytes = 255;
constexpr double kSecondsPerJob = 1;  // aim of the engine for one session

/// What the analysis is asked for, as it is stored with the job: the query's `columns`, `sample_rate_hz` and `side`.
Result<Json> reading_options(const Request& request) {
  Json options = Json::object();
  std::string columns = request.parameter("columns");
  if (const std::string side = request.parameter("side"); !side.empty()) {
    columns += (columns.empty() ? "side=" : ",side=") + side;
  }
  if (!columns.empty()) {
    const auto mapping = parse_column_mapping(columns);
    if (!mapping) return tl::unexpected(mapping.error());
    options["columns"] = columns;
  }
  if (const auto rate = request.head.parameter("sample_rate_hz")) {
    double rate_hz = 0;
    const auto [end, error] = std::from_chars(rate->data(), rate->data() + rate->size(), rate_hz);
    if (error != std::errc() || end != rate->data() + rate->size()) {
      return fail("bad_parameter", fmt::format("sample_rate_hz: '{}' is not a number", *rate));
    }
    if (auto checked = check_sample_rate(rate_hz); !checked) return tl::unexpected(checked.error());
    options["sample_rate_hz"] = rate_hz;
  }
  return options;
}

Result<std::optional<IdempotencyKey>> idempotency_key(const Request& request) {
  const auto key = request.head.header("idempotency-key");
  if (!key) return std::nullopt;
  if (key->empty() || key->size() > kMaxIdempotencyKeyBytes) {
    return fail("bad_parameter", fmt::format("an Idempotency-Key has 1 to {} characters", kMaxIdempotencyKeyBytes));
  }
  return IdempotencyKey{.principal = request.actor, .key = std::string(*key)};
}

Result<void> merge_label(std::optional<std::string>& label, const std::optional<std::string>& value,
                         std::string_view name, const std::string& file) {
  if (!value) return {};
  if (label && *label != *value) {
    Error error{.code = "contradicting_metadata"};
    error.file = file;
    error.field = name;
    error.found = *value;
    error.expected = *label;
    error.message = fmt::format("one submission is one valve: {} says {} '{}', an earlier file says '{}'", file, name,
                                *value, *label);
    return tl::unexpected(error);
  }
  label = value;
  return {};
}

/// The labels all files of a submission share; a label that only some carry holds for all.
Result<Labels> common_labels(const std::vector<ReceivedFile>& files) {
  Labels labels;
  for (const ReceivedFile& file : files) {
    const Metadata& said = file.metadata;
    for (const auto& [label, value, name] :
         {std::tuple(&labels.lot, &said.lot, "lot"), std::tuple(&labels.serial, &said.serial, "serial"),
          std::tuple(&labels.valve_type, &said.valve_type, "valve_type"),
          std::tuple(&labels.condition, &said.condition, "condition"),
          std::tuple(&labels.stand, &said.stand, "stand")}) {
      if (auto merged = merge_label(*label, *value, name, file.name); !merged) return tl::unexpected(merged.error());
    }
  }
  return labels;
}

/// What a file says of itself where its head does not tell. Of one that cannot be read nothing is known: its job will
/// say why. A machine too busy to read it is no such file: without its labels it would be judged by no reference.
Result<void> read_labels(Service& service, ReceivedFile& file, const std::string& options_json) {
  if (!file.labels_inside) return {};
  const auto place = PlaceForWork::take(service.computations);
  if (!place) return tl::unexpected(place.error());
  auto read = read_in_child(
      {.path = service.blobs.path_of(file.blob.sha256()), .name = file.name, .options_json = options_json},
      WhatToRead::kLabels, [&] { return !service.stopping(); });
  if (!read && status_of(read.error().code) == 503) return tl::unexpected(read.error());
  if (!read) return {};
  if (auto applied = apply_metadata_options(read->metadata, file.metadata); !applied) {
    applied.error().file = file.name;
    return applied;
  }
  file.metadata = std::move(read->metadata);
  return {};
}

Result<Accepted> accept_upload(Service& service, Request& request, bool alone) {
  if (service.stopping()) return fail("draining", "the server is shutting down; try again");
  auto key = idempotency_key(request);
  if (!key) return tl::unexpected(key.error());
  const auto options = reading_options(request);
  if (!options) return tl::unexpected(options.error());
  if (auto admitted = admit(service.store, service.blobs, service.limits); !admitted) {
    return tl::unexpected(admitted.error());
  }
  auto files = receive_files(service, request, alone ? 1 : kMaxFilesPerSubmission);
  if (!files) return tl::unexpected(files.error());
  for (ReceivedFile& file : *files) {
    if (auto read = read_labels(service, file, dump_json(*options)); !read) return tl::unexpected(read.error());
  }
  const auto labels = common_labels(*files);
  if (!labels) return tl::unexpected(labels.error());
  AcceptRequest accept{.labels = *labels,
                       .files = {},
                       .alone = alone,
                       .options_json = dump_json(*options),
                       .idempotency = std::move(*key),
                       .actor = request.actor};
  for (const ReceivedFile& file : *files) {
    accept.files.push_back({.name = file.name,
                            .blob = file.blob,
                            .test = file.metadata.test,
                            .metadata_json = dump_json(metadata_json(file.metadata))});
  }
  return accept_submission(service.store, accept, service.limits);
}

/// Overload is answered with the time the queue needs.
Response refusal(Service& service, const Error& error) {
  Response response = problem(error);
  if (error.code != "overloaded") return response;
  auto queue = service.store.queue_stats();
  const auto queued = queue ? queue->jobs[JobState::kQueued] : 0;
  std::erase_if(response.headers, [](const auto& header) { return header.first == "Retry-After"; });
  response.set_header("Retry-After", std::to_string(retry_after_s(queued, service.workers, kSecondsPerJob)));
  return response;
}

Response acceptance(Service& service, const Accepted& accepted, const Json& document, const std::string& location) {
  const bool stored_now = accepted.kind == AcceptKind::kCreated;
  if (stored_now) service.metrics.count_accepted_recordings(accepted.recordings.size());
  if (accepted.submission.state == JobState::kQueued) service.job_added();
  const bool says_202 = stored_now || (accepted.kind == AcceptKind::kReplayed && accepted.first_created);
  Response response = json_response(document, says_202 ? 202 : 200);
  response.set_header("Location", location);
  if (accepted.kind == AcceptKind::kReplayed) response.set_header("Idempotency-Replayed", "true");
  return response;
}

}  // namespace

Result<Response> post_recording(Service& service, Request& request) {
  const auto accepted = accept_upload(service, request, true);
  if (!accepted) return refusal(service, accepted.error());
  const RecordingRow& row = accepted->recordings.front();
  return acceptance(service, *accepted, view(row), "/v1/recordings/" + row.id);
}

Result<Response> post_submission(Service& service, Request& request) {
  const auto accepted = accept_upload(service, request, false);
  if (!accepted) return refusal(service, accepted.error());
  return acceptance(service, *accepted, view(accepted->submission, accepted->recordings),
                    "/v1/submissions/" + accepted->submission.id);
}

Result<Response> post_reanalyze(Service& service, Request& request) {
  if (service.stopping()) return fail("draining", "the server is shutting down; try again");
  std::string submission_id = request.captures[0];
  if (request.head.path[1] == "recordings") {
    const auto recording = service.store.recording(submission_id);
    if (!recording) return tl::unexpected(recording.error());
    submission_id = recording->submission_id;
  }
  const auto submission = service.store.submission(submission_id);
  if (!submission) return tl::unexpected(submission.error());
  const auto asked = reading_options(request);
  if (!asked) return tl::unexpected(asked.error());
  const auto options = asked->empty() ? reading_options_of(service.store, submission_id, submission->job_id)
                                      : Result<std::string>(dump_json(*asked));
  if (!options) return tl::unexpected(options.error());
  const auto job = service.store.reanalyze(submission_id, *options, request.actor, service.limits.max_queued_jobs);
  if (!job) return refusal(service, job.error());
  service.job_added();
  Response response = json_response(view(*job), 202);
  response.set_header("Location", "/v1/jobs/" + job->id);
  return response;
}

}  // namespace valvetriage::http
