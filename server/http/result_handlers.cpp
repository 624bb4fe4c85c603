#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <memory>

#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/subject.h"
#include "server/http/views.h"

namespace valvetriage::http {
namespace {

/// An open file that closes itself.
class OpenFile {
 public:
  explicit OpenFile(const std::string& path) : descriptor_(open(path.c_str(), O_RDONLY | O_CLOEXEC)) {}
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  ~OpenFile() {
    if (descriptor_ >= 0) close(descriptor_);
  }
  int descriptor() const { return descriptor_; }

 private:
  int descriptor_;
};

std::string media_type(std::string_view name) {
  if (name.ends_with(".json")) return "application/json";
  if (name.ends_with(".mat")) return "application/octet-stream";
  return "text/csv; charset=utf-8";
}

/// RFC 6266: a plain name for every client, the full one percent-encoded.
std::string attachment(std::string_view name) {
  std::string plain;
  for (const char c : name) {
    const bool safe =
        (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '.' || c == '-' || c == '_';
    plain.push_back(safe ? c : '_');
  }
  return fmt::format("attachment; filename=\"{}\"; filename*=UTF-8''{}", plain, percent_encode(name));
}

/// The stored bytes; their hash is their ETag, since they never change.
Result<Response> raw_bytes(Service& service, const Request& request, const RecordingRow& row) {
  Response response;
  if (is_known(request, row.sha256, response)) return response;
  const auto file = std::make_shared<OpenFile>(service.blobs.path_of(row.sha256));
  struct stat stored {};
  if (file->descriptor() < 0 || fstat(file->descriptor(), &stored) != 0 || stored.st_size != row.size_bytes)
    return fail("blob_damaged", "the stored bytes of this recording cannot be read; run 'valvetriage check'");
  response.content_type = media_type(row.name);
  response.set_header("Content-Disposition", attachment(row.name));
  response.set_header("Cache-Control", "private, immutable, max-age=31536000");
  response.stream_length = static_cast<std::uint64_t>(row.size_bytes);
  response.stream = [file, left = row.size_bytes](const Sink& sink) mutable {
    std::array<char, kPieceBytes> piece;
    while (left > 0) {
      const ssize_t n = read(file->descriptor(), piece.data(), piece.size());
      if (n <= 0 || !sink({piece.data(), static_cast<std::size_t>(n)})) return false;  // fewer than were announced
      left -= n;
    }
    return true;
  };
  return response;
}

Response analysis_response(const Request& request, const AnalysisRow& row, std::string body) {
  Response response;
  response.set_header("Content-Location", "/v1/analyses/" + row.id);
  if (!is_known(request, row.id, response)) response.body = std::move(body);
  return response;
}

template <typename Row>
std::vector<Json> views(const std::vector<Row>& rows) {
  std::vector<Json> items;
  items.reserve(rows.size());
  for (const Row& row : rows) items.push_back(view(row));
  return items;
}

}  // namespace

Result<Response> list_recordings(Service& service, Request& request) {
  const auto filter = filter_of(request);
  if (!filter) return tl::unexpected(filter.error());
  const auto page = page_request(request);
  if (!page) return tl::unexpected(page.error());
  const auto rows = service.store.list_recordings(*filter, *page);
  if (!rows) return tl::unexpected(rows.error());
  return list_response(request, views(rows->items), rows->next);
}

Result<Response> list_submissions(Service& service, Request& request) {
  const auto filter = filter_of(request);
  if (!filter) return tl::unexpected(filter.error());
  const auto page = page_request(request);
  if (!page) return tl::unexpected(page.error());
  const auto rows = service.store.list_submissions(*filter, *page);
  if (!rows) return tl::unexpected(rows.error());
  return list_response(request, views(rows->items), rows->next);
}

Result<Response> get_recording(Service& service, Request& request) {
  const auto row = service.store.recording(request.captures[0]);
  if (!row) return tl::unexpected(row.error());
  return json_response(view(*row));
}

Result<Response> get_submission(Service& service, Request& request) {
  const auto row = service.store.submission(request.captures[0]);
  if (!row) return tl::unexpected(row.error());
  const auto recordings = service.store.recordings_of(row->id);
  if (!recordings) return tl::unexpected(recordings.error());
  return json_response(view(*row, *recordings));
}

Result<Response> get_recording_raw(Service& service, Request& request) {
  const auto row = service.store.recording(request.captures[0]);
  if (!row) return tl::unexpected(row.error());
  return raw_bytes(service, request, *row);
}

Result<Response> get_submission_raw(Service& service, Request& request) {
  const auto row = recording_asked_for(service, request);
  if (!row) return tl::unexpected(row.error());
  return raw_bytes(service, request, *row);
}

Result<Response> get_analysis(Service& service, Request& request) {
  const auto submission = submission_asked_for(service, request);
  if (!submission) return tl::unexpected(submission.error());
  const auto row = analysis_asked_for(service, *submission);
  if (!row) return tl::unexpected(row.error());
  auto body = service.store.analysis_body(row->id);
  if (!body) return tl::unexpected(body.error());
  return analysis_response(request, *row, std::move(*body));
}

Result<Response> get_stored_analysis(Service& service, Request& request) {
  auto body = service.store.analysis_body(request.captures[0]);
  if (!body) return tl::unexpected(body.error());
  Response response;
  response.body = std::move(*body);
  return response;
}

Result<Response> list_analyses(Service& service, Request& request) {
  const auto submission = submission_asked_for(service, request);
  if (!submission) return tl::unexpected(submission.error());
  const auto rows = service.store.analyses_of(submission->id);
  if (!rows) return tl::unexpected(rows.error());
  return whole_list_response(request, views(*rows));
}

Result<Response> get_job(Service& service, Request& request) {
  const auto row = service.store.job(request.captures[0]);
  if (!row) return tl::unexpected(row.error());
  return json_response(view(*row));
}

Result<Response> post_cancel(Service& service, Request& request) {
  const auto row = service.store.cancel(request.captures[0], request.actor);
  if (!row) return tl::unexpected(row.error());
  return json_response(view(*row));
}

}  // namespace valvetriage::http
