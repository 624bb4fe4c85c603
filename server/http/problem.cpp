#include "server/http/problem.h"

#include <array>
#include <string_view>

namespace valvetriage::http {
namespace {

struct Code {
  std::string_view code;
  int status;
  std::string_view title;
};

// Codes that are not listed belong to the content of a recording or document: 422.
constexpr std::array kCodes{
    Code{"malformed_request", 400, "Malformed request"},
    Code{"bad_parameter", 400, "Bad parameter"},
    Code{"unknown_parameter", 400, "Unknown parameter"},
    Code{"invalid_cursor", 400, "Bad cursor"},
    Code{"invalid_limit", 400, "Bad limit"},
    Code{"recording_needed", 400, "Recording needed"},
    Code{"no_files", 400, "No files"},
    Code{"malformed_multipart", 400, "Malformed multipart body"},
    Code{"malformed_encoding", 400, "Malformed content encoding"},
    Code{"incomplete_body", 400, "Incomplete body"},
    Code{"token_missing", 401, "Token missing"},
    Code{"token_unknown", 401, "Token unknown or revoked"},
    Code{"scope_missing", 403, "Scope missing"},
    Code{"cross_site", 403, "Cross-site request"},
    Code{"host_not_allowed", 403, "Host not allowed"},
    Code{"not_found", 404, "Not found"},
    Code{"not_available", 404, "Not available"},
    Code{"method_not_allowed", 405, "Method not allowed"},
    Code{"request_timeout", 408, "Request too slow"},
    Code{"not_cancellable", 409, "Not cancellable"},
    Code{"not_finished", 409, "Not finished"},
    Code{"too_large", 413, "Too large"},
    Code{"too_many_files", 413, "Too many files"},
    Code{"unsupported_encoding", 415, "Unsupported content encoding"},
    Code{"unsupported_media_type", 415, "Unsupported media type"},
    Code{"expectation_failed", 417, "Expectation failed"},
    Code{"idempotency_conflict", 422, "Idempotency key used for another request"},
    Code{"head_too_large", 431, "Head too large"},
    Code{"too_many_headers", 431, "Too many headers"},
    Code{"internal", 500, "Internal error"},
    Code{"io_error", 500, "Internal error"},
    Code{"cannot_read", 500, "Stored bytes not readable"},
    Code{"blob_damaged", 500, "Stored bytes damaged"},
    Code{"store_broken", 500, "Database damaged"},
    Code{"unsupported_transfer_coding", 501, "Unsupported transfer coding"},
    Code{"draining", 503, "Shutting down"},
    Code{"overloaded", 503, "Too many jobs waiting"},
    Code{"busy", 503, "Temporarily busy"},
    Code{"cannot_start_child", 503, "Temporarily busy"},
    Code{"reading_timeout", 503, "Temporarily busy"},
    Code{"store_busy", 503, "Temporarily busy"},
    Code{"unsupported_http_version", 505, "Unsupported HTTP version"},
    Code{"no_space", 507, "No space left"},
    Code{"read_only", 507, "Storage is read-only"},
};

const Code* find_code(std::string_view code) {
  for (const Code& known : kCodes) {
    if (known.code == code) return &known;
  }
  return nullptr;
}

std::string title_of(const Error& error) {
  if (const Code* known = find_code(error.code)) return std::string(known->title);
  std::string title = error.code;
  for (char& c : title) {
    if (c == '_') c = ' ';
  }
  if (!title.empty() && title[0] >= 'a' && title[0] <= 'z') title[0] = static_cast<char>(title[0] - 'a' + 'A');
  return title;
}

}  // namespace

int status_of(const std::string& code) {
  const Code* known = find_code(code);
  return known ? known->status : 422;
}

bool is_fault(const std::string& code) {
  const int status = status_of(code);
  return status == 500 || status == 507 || code == "store_busy";
}

Json problem_document(const Error& error) {
  Json document{{"type", "about:blank"},
                {"title", title_of(error)},
                {"status", status_of(error.code)},
                {"detail", error.message},
                {"code", error.code}};
  if (!error.file.empty()) document["file"] = error.file;
  if (error.line) document["line"] = *error.line;
  if (error.column) document["column"] = *error.column;
  if (!error.field.empty()) document["field"] = error.field;
  if (!error.found.empty()) document["found"] = error.found;
  if (!error.expected.empty()) document["expected"] = error.expected;
  return document;
}

Response problem(const Error& error) {
  Response response;
  response.status = status_of(error.code);
  response.content_type = "application/problem+json";
  const Error hidden{.code = error.code,
                     .message = title_of(error) + "; the server's log says more under X-Request-Id"};
  response.body = dump_json(problem_document(is_fault(error.code) ? hidden : error));
  if (response.status == 503 || response.status == 507) response.set_header("Retry-After", "5");
  if (response.status == 401) response.set_header("WWW-Authenticate", "Bearer realm=\"valvetriage\"");
  return response;
}

}  // namespace valvetriage::http
