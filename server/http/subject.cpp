#include "server/http/subject.h"

#include <fmt/format.h>

#include <algorithm>

#include "server/wire/reference_json.h"

namespace valvetriage::http {
namespace {

bool is_recording_route(const Request& request) {
  return request.head.path[1] == "recordings";
}

}  // namespace

Result<SubmissionRow> submission_asked_for(Service& service, const Request& request) {
  if (!is_recording_route(request)) return service.store.submission(request.captures[0]);
  const auto recording = service.store.recording(request.captures[0]);
  if (!recording) return tl::unexpected(recording.error());
  return service.store.submission(recording->submission_id);
}

Result<RecordingRow> recording_asked_for(Service& service, const Request& request) {
  if (is_recording_route(request)) return service.store.recording(request.captures[0]);
  const auto submission = service.store.submission(request.captures[0]);
  if (!submission) return tl::unexpected(submission.error());
  const auto rows = service.store.recordings_of(submission->id);
  if (!rows) return tl::unexpected(rows.error());
  const std::string wanted = request.parameter("recording");
  if (wanted.empty()) {
    if (rows->size() == 1) return rows->front();
    Error error{.code = "recording_needed"};
    error.field = "recording";
    error.message = fmt::format("this submission has {} recordings; choose one with recording=ID", rows->size());
    return tl::unexpected(error);
  }
  const auto found = std::find_if(rows->begin(), rows->end(), [&](const auto& row) { return row.id == wanted; });
  if (found == rows->end()) return fail("not_found", "this submission has no such recording");
  return *found;
}

Result<AnalysisRow> analysis_asked_for(Service& service, const SubmissionRow& submission) {
  auto row = service.store.newest_analysis(submission.id);
  if (row || row.error().code != "not_found") return row;
  const std::string_view state = to_text(submission.state);
  if (is_final(submission.state)) {
    return fail("not_available", fmt::format("there is no analysis: the job ended as '{}', see 'error'", state));
  }
  return fail("not_finished", fmt::format("the analysis is not finished: the job is '{}'", state));
}

Result<std::optional<Reference>> reference_to_show(Service& service, const Analysis& analysis) {
  const auto leaves = [](const RecordingSummary& recording) {
    return std::any_of(recording.quality.begin(), recording.quality.end(),
                       [](const QualityItem& item) { return item.code == "outside_reference"; });
  };
  const auto& compared = analysis.baseline.reference;
  const bool is_left = std::any_of(analysis.recordings.begin(), analysis.recordings.end(), leaves);
  if (!compared || !(is_left || analysis.baseline.on_known_tests)) return std::nullopt;
  const auto stored = service.store.document(DocumentKind::kReference, compared->valve_type, compared->version);
  if (!stored && stored.error().code == "not_found") return std::nullopt;
  if (!stored) return tl::unexpected(stored.error());
  return parse_json(stored->body_json).and_then(reference_from_json);
}

Result<AnalysisDocument> stored_analysis(Service& service, const AnalysisRow& row) {
  const auto body = service.store.analysis_body(row.id);
  if (!body) return tl::unexpected(body.error());
  const auto document = parse_json(*body);
  if (!document) return tl::unexpected(document.error());
  auto read = analysis_from_json(*document);
  if (!read) return fail("not_available", fmt::format("the stored analysis cannot be read: {}", read.error().message));
  return read;
}

}  // namespace valvetriage::http
