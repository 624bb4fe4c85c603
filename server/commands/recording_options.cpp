#include "server/commands/recording_options.h"

#include <array>

#include "core/recording/columns.h"
#include "core/recording/metadata.h"

namespace valvetriage {
namespace {

struct MetadataOption {
  const char* key;
  const char* flag;
  const char* help;
  std::optional<std::string> RecordingOptions::*value;
};

constexpr std::array<MetadataOption, 6> kMetadataOptions{
    {{"serial", "--serial", "Serial number of the valve", &RecordingOptions::serial},
     {"lot", "--lot", "Lot the valve came back with", &RecordingOptions::lot},
     {"valve_type", "--valve-type", "Type of the valve", &RecordingOptions::valve_type},
     {"condition", "--condition", "new, returned, prototype or unknown; a label only", &RecordingOptions::condition},
     {"test", "--test", "step, staircase, triangle, sweep or other; inferred when not said", &RecordingOptions::test},
     {"stand", "--stand", "Test stand that recorded", &RecordingOptions::stand}}};

constexpr const char* kGroup = "What the files do not say themselves";

}  // namespace

void add_column_options(CLI::App& verb, RecordingOptions& options) {
  verb.add_option("--columns", options.columns, "Other column names: time=t_s,input=u,output=y,side=temperature_C,...")
      ->group(kGroup);
  verb.add_option("--sample-rate-hz", options.sample_rate_hz, "Sampling rate, where there is no time column")
      ->group(kGroup);
}

void add_metadata_options(CLI::App& verb, RecordingOptions& options) {
  for (const MetadataOption& option : kMetadataOptions) {
    verb.add_option(option.flag, options.*option.value, option.help)->group(kGroup);
  }
}

Result<ReadOptions> read_options(const RecordingOptions& options) {
  ReadOptions read;
  read.allow_mat = true;
  auto mapping = parse_column_mapping(options.columns);
  if (!mapping) return tl::unexpected(mapping.error());
  read.mapping = std::move(*mapping);
  read.mapping.sample_rate_hz = options.sample_rate_hz;
  if (options.sample_rate_hz) {
    if (auto checked = check_sample_rate(*options.sample_rate_hz); !checked) return tl::unexpected(checked.error());
  }
  for (const MetadataOption& option : kMetadataOptions) {
    const auto& value = options.*option.value;
    if (!value) continue;
    if (auto set = set_metadata(read.metadata, option.key, *value); !set) return tl::unexpected(set.error());
  }
  return read;
}

Result<std::vector<ReadRecording>> read_recordings(const std::vector<std::string>& files, const ReadOptions& options) {
  std::vector<ReadRecording> recordings;
  for (const std::string& file : files) {
    auto read = read_recording_file(file, options);
    if (!read) return tl::unexpected(read.error());
    recordings.push_back(std::move(*read));
  }
  return recordings;
}

}  // namespace valvetriage
