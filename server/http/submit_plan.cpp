#include "server/http/submit_plan.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <map>

#include "core/recording/text.h"
#include "server/wire/expand.h"
#include "server/wire/metadata_head.h"
#include "server/wire/read_recording.h"
#include "server/wire/sha256.h"

namespace valvetriage::http {
namespace {

namespace fs = std::filesystem;

tl::unexpected<Error> cannot_read(const std::string& file) {
  Error error{.code = "cannot_read", .message = "the file cannot be read"};
  error.file = file;
  return tl::unexpected(error);
}

bool looks_like_recording(const fs::path& file) {
  const fs::path inner(expanded_name(file.string()));
  const std::string extension = to_lower_ascii(inner.extension().string());
  return extension == ".csv" || extension == ".json" || extension == ".mat";
}

/// Gives an opened file's bytes.
class StreamSource : public ByteSource {
 public:
  explicit StreamSource(std::ifstream& in) : in_(in) {}
  Result<std::size_t> read(std::span<char> buffer) override {
    in_.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    return static_cast<std::size_t>(in_.gcount());
  }
  bool rewind() override { return false; }

 private:
  std::ifstream& in_;
};

/// One that cannot be read has no labels: the server refuses it, with its reason.
Metadata labels_of_mat(const std::string& file, const ColumnMapping& mapping) {
  ReadOptions options;
  options.mapping = mapping;
  options.allow_mat = true;  // a command of the file's owner
  auto read = read_raw_recording_file(file, options);
  return read ? std::move(read->metadata) : Metadata{};
}

Result<Metadata> labels_of_file(const std::string& file, const ColumnMapping& mapping) {
  std::ifstream in(file, std::ios::binary);
  if (!in || fs::is_directory(file)) return cannot_read(file);
  StreamSource source(in);
  const auto expanded = expand(source, UINT64_MAX);
  std::string head(kMetadataHeadBytes, '\0');
  std::size_t size = 0;
  while (size < head.size()) {
    const auto n = expanded->read(std::span(head).subspan(size));
    if (!n || *n == 0) break;  // damaged files are refused by the server, with their reason
    size += *n;
  }
  if (format_of(std::string_view(head).substr(0, size)) == RecordingFormat::kMat) return labels_of_mat(file, mapping);
  auto metadata = metadata_head(std::string_view(head).substr(0, size));
  if (!metadata) metadata.error().file = file;
  return metadata;
}

Result<void> add_folder(const fs::path& folder, std::vector<PlannedSubmission>& plan) {
  PlannedSubmission here{.title = folder.string(), .files = {}};
  std::vector<fs::path> below;
  std::error_code error;
  fs::directory_iterator at(folder, error);
  for (; !error && at != fs::directory_iterator(); at.increment(error)) {
    std::error_code unreadable;
    const fs::directory_entry& entry = *at;
    // A linked folder is not walked into: it may lie above.
    if (entry.is_directory(unreadable) && !entry.is_symlink(unreadable)) below.push_back(entry.path());
    if (entry.is_regular_file(unreadable) && looks_like_recording(entry.path())) {
      here.files.push_back(entry.path().string());
    }
  }
  if (error) return cannot_read(folder.string());
  std::sort(here.files.begin(), here.files.end());
  std::sort(below.begin(), below.end());
  if (!here.files.empty()) plan.push_back(std::move(here));
  for (const fs::path& inner : below) {
    if (auto added = add_folder(inner, plan); !added) return added;
  }
  return {};
}

}  // namespace

Result<std::vector<PlannedSubmission>> plan_submissions(const std::vector<std::string>& arguments,
                                                        const Metadata& labels, const ColumnMapping& mapping) {
  std::vector<PlannedSubmission> plan;
  std::map<std::pair<std::string, std::string>, std::size_t> by_valve;
  for (const std::string& argument : arguments) {
    std::error_code unreadable;  // a file then, whose reading says why
    if (fs::is_directory(argument, unreadable)) {
      const std::size_t before = plan.size();
      if (auto added = add_folder(argument, plan); !added) return tl::unexpected(added.error());
      if (plan.size() != before) continue;
      Error none{.code = "no_recordings", .message = "the folder holds no .csv, .json or .mat file"};
      none.file = argument;
      return tl::unexpected(none);
    }
    const auto said = labels_of_file(argument, mapping);
    if (!said) return tl::unexpected(said.error());
    const std::string serial = said->serial.value_or(labels.serial.value_or(""));
    const std::string lot = said->lot.value_or(labels.lot.value_or(""));
    const auto known = by_valve.find({lot, serial});
    if (!serial.empty() && known != by_valve.end()) {
      plan[known->second].files.push_back(argument);
      continue;
    }
    if (!serial.empty()) by_valve[{lot, serial}] = plan.size();
    plan.push_back({.title = serial.empty() ? argument
                             : lot.empty()  ? serial
                                            : lot + " " + serial,
                    .files = {argument}});
  }
  return plan;
}

Result<std::string> content_key(const std::string& route, const std::vector<std::string>& files) {
  Sha256 all;
  all.update(route);
  std::array<char, 64 * 1024> piece;
  for (const std::string& file : files) {
    std::ifstream in(file, std::ios::binary);
    if (!in) return cannot_read(file);
    Sha256 one;
    while (in.read(piece.data(), piece.size()), in.gcount() > 0) {
      one.update({piece.data(), static_cast<std::size_t>(in.gcount())});
    }
    all.update("\n" + fs::path(file).filename().string() + "\n" + one.hex());
  }
  return all.hex();
}

}  // namespace valvetriage::http
