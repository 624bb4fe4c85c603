#include "server/jobs/learning_child.h"

#include <fmt/format.h>

#include <cstdio>
#include <iostream>
#include <iterator>
#include <new>
#include <utility>

#include "core/analysis/learn_reference.h"
#include "server/jobs/child_process.h"
#include "server/jobs/child_protocol.h"
#include "server/wire/json.h"
#include "server/wire/json_fields.h"
#include "server/wire/read_recording.h"
#include "server/wire/reference_json.h"

namespace valvetriage {
namespace {

// The answer is one line: {"reference":{...}} or {"refused":{...}}.

// Eight sessions of 24,000 samples take 60 MB and up to 30 s of a busy processor, twice that where what they leave in
// common is taken off and they are learned once more.
constexpr std::int64_t kPatienceS = 3600;
constexpr std::int64_t kMemoryBytes = std::int64_t{8} << 30;

Json to_json(const GoodValve& valve) {
  Json files = Json::array();
  for (const FileToRead& file : valve.files) files.push_back(to_json(file));
  return {{"serial", valve.serial}, {"files", std::move(files)}};
}

struct ToLearn {
  std::string valve_type;
  std::vector<GoodValve> valves;
};

Result<ToLearn> to_learn_from(const Json& document) {
  std::optional<Error> error;
  JsonFields fields(document, "", error);
  ToLearn learn{.valve_type = fields.text("valve_type"), .valves = {}};
  for (JsonFields valve : fields.objects("valves")) {
    GoodValve& good = learn.valves.emplace_back();
    good.serial = valve.text("serial");
    for (JsonFields file : valve.objects("files")) good.files.push_back(file_to_read_from(file));
  }
  if (error) return tl::unexpected(*error);
  return learn;
}

Result<Recording> read(const FileToRead& file) {
  auto options = read_options_of(file);
  if (!options) return tl::unexpected(options.error());
  options->allow_mat = true;  // the child is there for that
  auto read = read_recording_file(file.path, *options);
  if (!read) return tl::unexpected(read.error());
  return std::move(read->recording);
}

Result<Reference> learn_here(const ToLearn& learn) {
  std::vector<ValveRecordings> valves;
  for (const GoodValve& good : learn.valves) {
    ValveRecordings& valve = valves.emplace_back();
    valve.serial = good.serial;
    for (const FileToRead& file : good.files) {
      auto recording = read(file);
      if (!recording) return tl::unexpected(recording.error());
      valve.recordings.push_back(std::move(*recording));
    }
  }
  return learn_reference(valves, learn.valve_type);
}

Result<Reference> learn_guarded(const ToLearn& learn) {
  try {
    return learn_here(learn);
  } catch (const std::bad_alloc&) {
    return fail("out_of_memory", "so many recordings need more memory than learning a reference may have");
  }
}

Result<Reference> reference_in(std::string_view line) {
  const auto said = parse_json(line);
  if (!said) return tl::unexpected(said.error());
  std::optional<Error> error;
  JsonFields fields(*said, "", error);
  if (fields.has("reference")) return reference_from_json(fields.raw("reference"));
  const Error refused = refusal_from(fields.object("refused"));
  return tl::unexpected(error.value_or(refused));
}

}  // namespace

Result<Reference> learn_in_child(const std::vector<GoodValve>& valves, const std::string& valve_type,
                                 std::function<bool()> keep_going) {
  Json good = Json::array();
  for (const GoodValve& valve : valves) good.push_back(to_json(valve));
  const std::string asked = dump_json({{"valve_type", valve_type}, {"valves", std::move(good)}});
  const ChildLimits limits{.memory_bytes = kMemoryBytes, .cpu_s = kPatienceS, .wall_ms = 1000 * kPatienceS};
  Result<Reference> reference = fail("learning_failed", "the process that learned the reference gave no answer");
  const auto ended = run_child_process(
      {"/proc/self/exe", std::string(kLearningVerb)}, asked, limits,
      {.on_line = [&](std::string_view line) { reference = reference_in(line); }, .keep_going = std::move(keep_going)});
  if (!ended) return tl::unexpected(ended.error());
  if (ended->end != ChildEnd::kExited || ended->status != 0) {
    return fail("learning_failed", "no reference could be learned within the time and memory that it may take");
  }
  return reference;
}

int run_learning_child() {
  const std::string text{std::istreambuf_iterator<char>(std::cin), {}};
  const auto learn = to_learn_from(parse_json(text).value_or(Json()));
  if (!learn) {
    fmt::print(stderr, "what to learn from could not be read: {}\n", learn.error().message);
    return 1;
  }
  const auto reference = learn_guarded(*learn);
  const Json answer =
      reference ? Json{{"reference", to_json(*reference)}} : Json{{"refused", refusal_json(reference.error())}};
  fmt::print("{}\n", dump_json(answer));
  return 0;
}

}  // namespace valvetriage
