// The contract tests of the service, and the child that their servers start for each job: this executable with the verb
// `analysis-child`; `reading-child` and `learning-child` are the real ones. `serve DIR [PORT]` runs a server alone, for
// tests that kill it.

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <thread>

#include "core/recording/columns.h"
#include "server/http/serve.h"
#include "server/jobs/child_protocol.h"
#include "server/jobs/learning_child.h"
#include "server/jobs/reading_child.h"
#include "server/report/valve_residuals.h"
#include "server/wire/analysis_json.h"
#include "server/wire/json.h"
#include "server/wire/model_json.h"
#include "server/wire/read_recording.h"
#include "server/wire/residuals_json.h"
#include "server/wire/sha256.h"

namespace valvetriage {
namespace {

std::string example_analysis() {
  std::ifstream file(VALVETRIAGE_SOURCE_DIR "/schemas/examples/valid/analysis_named_cause.json");
  return {std::istreambuf_iterator<char>(file), {}};
}

/// The schema's example, or what the recording's complaint asks for: "unexplained", "ambiguous" (with a next test),
/// "named friction sensor_offset";
/// "unexplained kept" keeps the residuals as the real analyser does, which the others leave to whoever asks; "wait
/// FILE" gives the example as soon as there is such a file.
Json analysis_asked_for(const std::optional<std::string>& complaint) {
  Json document = *parse_json(example_analysis());
  if (!complaint) return document;
  if (complaint->starts_with("wait ")) {
    while (!std::filesystem::exists(complaint->substr(5))) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    return document;
  }
  Json& found = document["discrepancy"];
  std::istringstream words(*complaint);
  std::string word;
  words >> word;
  found["conclusion"] = word;
  if (word == "named") {
    const Json example = found["causes"][0];
    found["causes"] = Json::array();
    while (words >> word) {
      found["causes"].push_back(example);
      found["causes"].back()["cause"] = word;
      if (word != "intermittent") continue;
      Json& parameters = found["causes"].back()["parameters"];
      parameters["recording"] = parameters["breakaway_A"];  // in which one it is, by its index
      parameters["recording"]["value"] = 0;
      parameters["recording"]["unit"] = "";
    }
  } else {
    found["causes"] = Json::array();
  }
  if (word == "ambiguous") {
    found["next_test"] = {{"test", "triangle"},
                          {"why", "it turns around slowly"},
                          {"separates", {"friction", "backlash"}},
                          {"expected_probability", 0.9},
                          {"input_csv", "time_s,current_A\n0,1.2\n0.005,1.21\n"}};
  }
  document["result_sha256"] = result_sha256(document);
  return document;
}

/// Reads every recording as the real analyser does, so that bad input is found; the result is the schema's example.
Result<NewAnalysis> read_only_analysis(const JobSpec& spec, const StageReport& progress) {
  const auto options = parse_json(spec.options_json);
  if (!options) return tl::unexpected(options.error());
  std::string hashes;
  std::optional<std::string> complaint;
  std::vector<Recording> recordings;
  for (const JobFile& file : spec.files) {
    ReadOptions read;
    read.name = file.name;
    read.allow_mat = true;
    const auto mapping = parse_column_mapping(options->value("columns", ""));
    if (!mapping) return tl::unexpected(mapping.error());
    read.mapping = *mapping;
    if (options->contains("sample_rate_hz")) read.mapping.sample_rate_hz = (*options)["sample_rate_hz"].get<double>();
    auto recording = read_recording_file(file.path, read);
    if (!recording) return tl::unexpected(recording.error());
    hashes += recording->sha256;
    complaint = recording->recording.metadata.complaint;
    recordings.push_back(std::move(recording->recording));
    progress(0.5, "read");
  }
  NewAnalysis analysis{.engine_version = VALVETRIAGE_VERSION,
                       .settings_sha256 = sha256_hex("none"),
                       .result_sha256 = sha256_hex(hashes),
                       .summary = {},
                       .body_json = {}};
  analysis.summary.verdict = "Good";
  analysis.summary.action = "accept";
  analysis.summary.errors = {{.level_a = 1.4, .error_eq20 = 2.5}};
  analysis.summary.features = {{"bandwidth_hz", 2.25}};
  const Json document = analysis_asked_for(complaint);
  analysis.body_json = document.dump();
  const Json& found = document["discrepancy"];
  analysis.summary.conclusion = found["conclusion"].get<std::string>();
  if (!found["causes"].empty()) {
    analysis.summary.top_cause = found["causes"][0]["cause"].get<std::string>();
    analysis.summary.top_cause_probability = found["causes"][0]["probability"].get<double>();
  }
  if (complaint && complaint->ends_with(" kept")) {
    const Json& model = document["baseline"]["model"];
    analysis.residuals_json =
        residuals_to_json(report::valve_residuals(std::move(recordings), *model_from_json(model)));
  }
  for (const Json& cause : found["causes"]) {
    analysis.summary.causes.push_back({.cause = cause["cause"].get<std::string>(),
                                       .probability = cause["probability"].get<double>(),
                                       .settled = true});
  }
  return analysis;
}

int serve_alone(const char* folder, const char* port) {
  http::ServeOptions options;
  options.listen = std::string("127.0.0.1:") + port;
  options.database_file = std::string(folder) + "/valvetriage.sqlite";
  options.data_dir = folder;
  options.log_requests = false;
  const auto served = http::serve(options, [](const http::Endpoint& endpoint) {
    fmt::print("{}\n", endpoint.port);
    std::fflush(stdout);
  });
  if (served) return 0;
  fmt::print(stderr, "{}\n", served.error().message);
  return 1;
}

}  // namespace
}  // namespace valvetriage

int main(int argc, char** argv) {
  if (argc > 1 && std::strcmp(argv[1], "analysis-child") == 0)
    return valvetriage::run_child(valvetriage::read_only_analysis);
  if (argc > 1 && argv[1] == valvetriage::kReadingVerb) return valvetriage::run_reading_child();
  if (argc > 1 && argv[1] == valvetriage::kLearningVerb) return valvetriage::run_learning_child();
  if (argc > 2 && std::strcmp(argv[1], "serve") == 0)
    return valvetriage::serve_alone(argv[2], argc > 3 ? argv[3] : "0");
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
