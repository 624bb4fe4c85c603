// Any bytes through the CSV reader and the preparation: an answer or an Error, never anything else.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "core/recording/metadata.h"
#include "core/recording/prepare.h"
#include "tests/unit/recording/csv_text.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace valvetriage;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  (void)read_metadata_head(text);
  for (const ColumnMapping& mapping :
       {ColumnMapping{},
        ColumnMapping{.time = "t", .input = "u", .output = "y", .side = {"s"}, .sample_rate_hz = {}}}) {
    TextSource source{std::string(text)};
    auto raw = parse_csv(source, "fuzz.csv", mapping);
    if (!raw) {
      if (raw.error().code.empty() || raw.error().message.empty()) std::abort();
      continue;
    }
    const std::size_t rows = raw->input.values.size();
    if (rows != raw->output.values.size() || rows != raw->time.values.size()) std::abort();
    const auto recording = prepare_recording(std::move(*raw), mapping);
    if (recording && recording->samples() != recording->input.values.size()) std::abort();
  }
  return 0;
}
