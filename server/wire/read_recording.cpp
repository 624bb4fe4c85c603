#include "server/wire/read_recording.h"

#include <errno.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstring>

#include "core/recording/metadata.h"
#include "core/recording/prepare.h"
#include "core/recording/text.h"
#include "server/wire/byte_source.h"
#include "server/wire/expand.h"
#include "server/wire/json_recording.h"
#include "server/wire/mat_recording.h"

namespace valvetriage {
namespace {

class OpenFile {
 public:
  explicit OpenFile(const std::string& path) : descriptor_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOCTTY)) {}
  ~OpenFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  int descriptor() const { return descriptor_; }

 private:
  int descriptor_;
};

tl::unexpected<Error> cannot_read(const std::string& name, std::string_view why) {
  Error error{.code = "cannot_read", .message = fmt::format("cannot read '{}': {}", name, why), .file = name};
  return tl::unexpected(error);
}

std::string last_part(const std::string& path) {
  return path.substr(path.find_last_of('/') + 1);
}

/// Where the bytes come from: `path` is empty unless they lie in a file of their own.
struct Origin {
  ByteSource& bytes;
  std::string path{};
};

Result<RawRecording> parse(ByteSource& text, RecordingFormat format, const std::string& path_of_text,
                           const ReadOptions& options) {
  switch (format) {
    case RecordingFormat::kJson:
      return parse_json_recording(text, options.name, options.mapping);
    case RecordingFormat::kMat:
      if (!options.allow_mat) return fail("mat_not_allowed", "MAT files are not read here");
      return path_of_text.empty() ? parse_mat_recording(text, options.name, options.mapping)
                                  : parse_mat_file(path_of_text, options.name, options.mapping);
    case RecordingFormat::kCsv:
      break;
  }
  return parse_csv(text, options.name, options.mapping);
}

struct RawRead {
  RawRecording raw;
  std::string sha256;
  std::size_t bytes = 0;
};

Result<RawRead> read_raw(const Origin& origin, const ReadOptions& options) {
  PeekedSource packed(origin.bytes);
  const auto packed_head = packed.peek();
  if (!packed_head) return tl::unexpected(packed_head.error());
  const Compression compression = compression_of_bytes(*packed_head);
  const auto expanded = expand(compression, packed, options.max_expanded_bytes);
  HashedSource hashed(*expanded);
  PeekedSource text(hashed);
  const auto head = text.peek();
  if (!head) return tl::unexpected(head.error());

  auto raw = parse(text, format_of(*head), compression == Compression::kNone ? origin.path : "", options);
  if (!raw) return tl::unexpected(raw.error());
  if (auto merged = apply_metadata_options(raw->metadata, options.metadata); !merged) {
    return tl::unexpected(merged.error());
  }
  if (auto drained = hashed.drain(); !drained) return tl::unexpected(drained.error());
  return RawRead{std::move(*raw), hashed.sha256(), hashed.bytes()};
}

Result<ReadRecording> read(const Origin& origin, const ReadOptions& options) {
  auto read = read_raw(origin, options);
  if (!read) return tl::unexpected(read.error());
  auto recording = prepare_recording(std::move(read->raw), options.mapping);
  if (!recording) return tl::unexpected(recording.error());
  return ReadRecording{std::move(*recording), read->sha256, read->bytes};
}

/// The same, an error saying which file it is in.
template <typename T>
Result<T> in_file(Result<T> read, const std::string& name) {
  if (!read) read.error().file = name;
  return read;
}

template <typename Read>
auto with_file(const std::string& path, const ReadOptions& options, const Read& read)
    -> decltype(read(std::declval<const Origin&>(), options)) {
  ReadOptions named = options;
  if (named.name.empty()) named.name = last_part(path);
  const OpenFile file(path);
  struct stat status {};
  if (file.descriptor() < 0 || ::fstat(file.descriptor(), &status) != 0) {
    return cannot_read(named.name, std::strerror(errno));
  }
  if (S_ISDIR(status.st_mode)) return cannot_read(named.name, "it is a folder; name the files in it");
  DescriptorSource source(file.descriptor());
  // Opened anew under the descriptor's own name: what was opened once is what is read.
  return read({source, S_ISREG(status.st_mode) ? fmt::format("/proc/self/fd/{}", file.descriptor()) : ""}, named);
}

}  // namespace

RecordingFormat format_of(std::string_view first_bytes) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (is_mat(first_bytes)) return RecordingFormat::kMat;
  if (first_bytes.starts_with(kByteOrderMark)) first_bytes.remove_prefix(kByteOrderMark.size());
  const std::size_t first = first_bytes.find_first_not_of(" \t\r\n");
  const bool json = first != std::string_view::npos && (first_bytes[first] == '{' || first_bytes[first] == '[');
  return json ? RecordingFormat::kJson : RecordingFormat::kCsv;
}

Result<ReadRecording> read_recording(ByteSource& source, const ReadOptions& options) {
  return in_file(read({source}, options), options.name);
}

Result<ReadRecording> read_recording_file(const std::string& path, const ReadOptions& options) {
  return with_file(path, options, [](const Origin& origin, const ReadOptions& named) {
    return in_file(read(origin, named), named.name);
  });
}

Result<RawRecording> read_raw_recording_file(const std::string& path, const ReadOptions& options) {
  return with_file(path, options, [](const Origin& origin, const ReadOptions& named) -> Result<RawRecording> {
    auto read = in_file(read_raw(origin, named), named.name);
    if (!read) return tl::unexpected(read.error());
    return std::move(read->raw);
  });
}

Result<ReadRecording> read_recording_descriptor(int descriptor, const ReadOptions& options) {
  DescriptorSource source(descriptor);
  return read_recording(source, options);
}

Result<ReadRecording> read_recording_memory(std::string_view bytes, const ReadOptions& options) {
  MemorySource source(bytes);
  return read_recording(source, options);
}

}  // namespace valvetriage
