// Any bytes through the JSON reader of recordings: an answer or an Error, never anything else.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "core/recording/prepare.h"
#include "server/wire/byte_source.h"
#include "server/wire/json_recording.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace valvetriage;
  MemorySource source(std::string_view(reinterpret_cast<const char*>(data), size));
  auto raw = parse_json_recording(source, "fuzz.json", {});
  if (!raw) {
    if (raw.error().code.empty() || raw.error().message.empty()) std::abort();
    return 0;
  }
  const auto recording = prepare_recording(std::move(*raw), {});
  if (recording && recording->samples() != recording->input.values.size()) std::abort();
  return 0;
}
