#pragma once

#include <string>
#include <vector>

#include "server/store/store.h"
#include "server/wire/sha256.h"

namespace valvetriage::test {

inline NewRecording a_recording(const std::string& content) {
  return {.name = content + ".csv",
          .sha256 = sha256_hex(content),
          .size_bytes = static_cast<std::int64_t>(content.size()),
          .test = "step",
          .metadata_json = R"({"operator":"kim"})"};
}

inline Labels a_valve(const std::string& lot, const std::string& serial) {
  return {.lot = lot, .serial = serial, .valve_type = "type-1", .condition = "returned", .stand = "stand-3"};
}

/// One recording sent alone.
inline NewSubmission alone(const Labels& labels, const std::string& content) {
  NewSubmission submission;
  submission.labels = labels;
  submission.recordings = {a_recording(content)};
  submission.alone = true;
  submission.request_sha256 = sha256_hex("request of " + content);
  return submission;
}

inline NewSubmission together(const Labels& labels, const std::vector<std::string>& contents) {
  NewSubmission submission;
  submission.labels = labels;
  for (const std::string& content : contents) submission.recordings.push_back(a_recording(content));
  submission.request_sha256 = sha256_hex("request of " + contents.front());
  return submission;
}

inline NewAnalysis an_analysis(const std::string& verdict, const std::string& cause = "friction") {
  NewAnalysis analysis{.engine_version = "0.1.0",
                       .settings_sha256 = sha256_hex("settings"),
                       .result_sha256 = sha256_hex(verdict + cause),
                       .summary = {},
                       .body_json = R"({"schema":"valvetriage.analysis/1"})",
                       .residuals_json = ""};
  analysis.summary.verdict = verdict;
  analysis.summary.action = "reject";
  analysis.summary.conclusion = "named";
  analysis.summary.top_cause = cause;
  analysis.summary.top_cause_probability = 0.97;
  analysis.summary.causes = {{.cause = cause, .probability = 0.97, .settled = true}};
  analysis.summary.errors = {{1.2, 0.031}, {2.0, 0.11}};
  analysis.summary.features = {{"bandwidth_hz", 2.25}, {"delay_s", 0.004}};
  return analysis;
}

}  // namespace valvetriage::test
