#pragma once

#include <string>
#include <vector>

#include "core/recording/recording.h"
#include "server/http/exchange.h"
#include "server/http/service.h"
#include "server/jobs/accept.h"
#include "server/wire/json.h"

namespace valvetriage::http {

/// One file of a request, expanded, hashed and durable, with what its head says about it.
struct ReceivedFile {
  std::string name;
  StoredBlob blob;
  Metadata metadata;
  bool labels_inside = false;  ///< its head cannot tell: a MAT file, or JSON with its metadata behind the columns
};

/// Streams every file of the body into the blob store: the raw body, or each part `file` of multipart/form-data.
/// Content-Encoding and file names that end in .gz or .zst are expanded under the byte bound.
///
/// Errors  `unsupported_encoding`, `unsupported_media_type`, `malformed_multipart`, `malformed_encoding`, `no_files`,
///         `too_many_files`, `too_large`, metadata that contradict the file; the body's and the blob store's
Result<std::vector<ReceivedFile>> receive_files(Service& service, Request& request, std::size_t max_files);

/// The whole body, expanded, at most `max_bytes`.
Result<std::string> receive_document(Request& request, std::size_t max_bytes);

/// The same, parsed.
Result<Json> receive_json(Request& request, std::size_t max_bytes);

}  // namespace valvetriage::http
