#include "server/http/receive.h"

#include <fmt/format.h>

#include "core/recording/limits.h"
#include "core/recording/metadata.h"
#include "core/recording/text.h"
#include "server/http/limits.h"
#include "server/http/multipart.h"
#include "server/wire/expand.h"
#include "server/wire/json_recording.h"
#include "server/wire/metadata_head.h"
#include "server/wire/read_recording.h"

namespace valvetriage::http {
namespace {

constexpr std::size_t kMaxNameBytes = 200;
// Between two looks at the disk: many uploads at once write no more than this each below what is to stay free.
constexpr std::size_t kBytesBetweenLooks = 4 << 20;

/// What the query says about every file of the request.
Result<Metadata> metadata_options(const Request& request) {
  Metadata options;
  for (const std::string_view key : {"serial", "lot", "valve_type", "condition", "test", "stand"}) {
    const auto value = request.head.parameter(key);
    if (!value || trim(*value).empty()) continue;
    if (auto set = set_metadata(options, key, trim(*value)); !set) return tl::unexpected(set.error());
  }
  return options;
}

/// A name that is safe to show and to offer for saving, whatever was sent.
std::string clean_name(std::string_view sent, std::string_view first_bytes) {
  std::string_view name = sent.substr(sent.find_last_of("/\\") + 1);
  if (!name.empty() && name.size() <= kMaxNameBytes && name != "." && name != ".." && is_clean_utf8(name)) {
    return std::string(name);
  }
  if (first_bytes.starts_with("MATLAB")) return "recording.mat";
  return first_bytes.starts_with('{') ? "recording.json" : "recording.csv";
}

Error in_file(Error error, const std::string& name) {
  if (error.file.empty()) error.file = name;
  return error;
}

Result<ReceivedFile> receive_file(Service& service, ByteSource& bytes, const std::string& sent_name,
                                  const Metadata& options) {
  auto writer = service.blobs.begin(static_cast<std::int64_t>(kMaxExpandedBytes));
  if (!writer) return tl::unexpected(writer.error());
  const auto expanded = expand(bytes, kMaxExpandedBytes, kUploadZstdWindowLog2);
  std::string head, piece(kPieceBytes, '\0');
  std::size_t unlooked = kBytesBetweenLooks;
  for (;;) {
    if (unlooked >= kBytesBetweenLooks) {
      if (auto space = check_space(service.blobs, service.limits); !space) return tl::unexpected(space.error());
      unlooked = 0;
    }
    const auto n = expanded->read(piece);
    if (!n) return tl::unexpected(in_file(n.error(), sent_name));
    if (*n == 0) break;
    const std::string_view received(piece.data(), *n);
    unlooked += *n;
    if (head.size() < kMetadataHeadBytes) head += received.substr(0, kMetadataHeadBytes - head.size());
    if (auto written = writer->write(received); !written) return tl::unexpected(in_file(written.error(), sent_name));
  }
  const std::string name = clean_name(expanded_name(sent_name), head);
  if (head.empty()) return tl::unexpected(in_file(Error{.code = "no_samples", .message = "the file is empty"}, name));
  auto metadata = metadata_head(head);
  if (!metadata) return tl::unexpected(in_file(metadata.error(), name));
  const RecordingFormat format = format_of(head);
  const bool labels_inside =
      format == RecordingFormat::kMat || (format == RecordingFormat::kJson && metadata_json(*metadata).empty());
  if (auto applied = apply_metadata_options(*metadata, options); !applied) {
    return tl::unexpected(in_file(applied.error(), name));
  }
  auto blob = writer->commit();
  if (!blob) return tl::unexpected(blob.error());
  return ReceivedFile{name, std::move(*blob), std::move(*metadata), labels_inside};
}

Result<std::vector<ReceivedFile>> receive_parts(Service& service, ByteSource& body, const std::string& boundary,
                                                const Metadata& options, std::size_t max_files) {
  MultipartReader parts(body, boundary);
  std::vector<ReceivedFile> files;
  for (;;) {
    const auto part = parts.next();
    if (!part) return tl::unexpected(part.error());
    if (!*part) return files;
    if ((*part)->name != "file") {
      return fail("malformed_multipart",
                  fmt::format("a part is named '{}'; files come as parts named 'file', everything "
                              "else as query parameters",
                              shown((*part)->name)));
    }
    if (files.size() >= max_files) {
      return fail("too_many_files", fmt::format("at most {} file(s) can be sent here at a time", max_files));
    }
    auto file = receive_file(service, parts, (*part)->file_name, options);
    if (!file) return tl::unexpected(file.error());
    files.push_back(std::move(*file));
  }
}

Result<Compression> content_encoding(const Request& request) {
  const auto sent = request.head.header("content-encoding").value_or("");
  if (const auto compression = compression_of_encoding(to_lower_ascii(sent))) return *compression;
  Error error{.code = "unsupported_encoding"};
  error.found = shown(sent);
  error.expected = "gzip, zstd or no Content-Encoding";
  error.message = fmt::format("Content-Encoding '{}' is not accepted; {} is", error.found, error.expected);
  return tl::unexpected(error);
}

}  // namespace

Result<std::vector<ReceivedFile>> receive_files(Service& service, Request& request, std::size_t max_files) {
  const auto compression = content_encoding(request);
  if (!compression) return tl::unexpected(compression.error());
  const auto options = metadata_options(request);
  if (!options) return tl::unexpected(options.error());
  const std::uint64_t max_bytes = kMaxExpandedBytes * max_files + kMaxDocumentBytes;
  const auto body = expand(*compression, *request.body, max_bytes, kUploadZstdWindowLog2);

  const std::string_view type = request.head.header("content-type").value_or("");
  if (!to_lower_ascii(type).starts_with("multipart/")) {
    auto file = receive_file(service, *body, request.parameter("name"), *options);
    if (!file) return tl::unexpected(file.error());
    std::vector<ReceivedFile> files;
    files.push_back(std::move(*file));
    return files;
  }
  const auto boundary = multipart_boundary(type);
  if (!boundary) {
    return fail("unsupported_media_type",
                "several files come as multipart/form-data with a boundary of at most 70 characters");
  }
  auto files = receive_parts(service, *body, *boundary, *options, max_files);
  if (files && files->empty()) return fail("no_files", "the body has no part named 'file'");
  return files;
}

Result<std::string> receive_document(Request& request, std::size_t max_bytes) {
  const auto compression = content_encoding(request);
  if (!compression) return tl::unexpected(compression.error());
  const auto body = expand(*compression, *request.body, max_bytes, kUploadZstdWindowLog2);
  std::string document, piece(kPieceBytes, '\0');
  for (;;) {
    const auto n = body->read(piece);
    if (!n) return tl::unexpected(n.error());
    if (*n == 0) return document;
    document.append(piece, 0, *n);
  }
}

Result<Json> receive_json(Request& request, std::size_t max_bytes) {
  const auto document = receive_document(request, max_bytes);
  if (!document) return tl::unexpected(document.error());
  return parse_json(*document);
}

}  // namespace valvetriage::http
