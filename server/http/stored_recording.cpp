#include "server/http/stored_recording.h"

#include "core/recording/columns.h"
#include "server/wire/json.h"
#include "server/wire/read_recording.h"

namespace valvetriage::http {
namespace {

constexpr std::chrono::seconds kPatience{5};

Result<ColumnMapping> column_mapping(const std::string& options_json) {
  const auto options = parse_json(options_json);
  if (!options) return tl::unexpected(options.error());
  auto mapping = parse_column_mapping(options->value("columns", ""));
  if (mapping && options->contains("sample_rate_hz"))
    mapping->sample_rate_hz = (*options)["sample_rate_hz"].get<double>();
  return mapping;
}

}  // namespace

Result<ComputationPlace> ComputationPlace::take(Service& service) {
  if (service.computations.try_acquire_for(kPatience)) return ComputationPlace(&service);
  return fail("busy", "the server is computing other series and simulations; try again");
}

Result<Recording> read_stored_recording(Service& service, const RecordingRow& row) {
  const auto job = service.store.job(row.job_id);
  if (!job) return tl::unexpected(job.error());
  const auto mapping = column_mapping(job->options_json);
  if (!mapping) return tl::unexpected(mapping.error());
  ReadOptions options;
  options.name = row.name;
  options.mapping = *mapping;
  options.metadata.test = row.test;
  auto read = read_recording_file(service.blobs.path_of(row.sha256), options);
  if (!read && read.error().code == "mat_not_allowed") {
    return fail("not_available", "series of MAT files are not shown; the raw file and the analysis are there");
  }
  if (!read) return tl::unexpected(read.error());
  return std::move(read->recording);
}

}  // namespace valvetriage::http
