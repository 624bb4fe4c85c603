#include "server/jobs/analyze_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <numeric>

#include "server/wire/canonical_json.h"

namespace valvetriage {
namespace {

Result<void> check_one_valve(const std::vector<ReadRecording>& recordings) {
  if (recordings.empty()) return fail("no_recordings", "there is no recording to analyse");
  const ReadRecording* named = nullptr;
  for (const ReadRecording& read : recordings) {
    const auto& serial = read.recording.metadata.serial;
    if (!serial) continue;
    if (named && named->recording.metadata.serial != serial) {
      return fail("several_valves",
                  fmt::format("{} is of valve {}, {} of valve {}: the recordings of one valve are analysed together",
                              named->recording.name, *named->recording.metadata.serial, read.recording.name, *serial));
    }
    named = &read;
  }
  return {};
}

/// Good valves of another type say nothing about this one.
Result<void> check_valve_type(const std::vector<ReadRecording>& recordings, const AnalysisOptions& options) {
  const bool asked = !options.baseline || options.baseline == BaselineKind::kReference;
  if (!options.reference || !asked) return {};
  for (const ReadRecording& read : recordings) {
    const auto& type = read.recording.metadata.valve_type;
    if (!type || *type == options.reference->valve_type) continue;
    Error error{.code = "contradicting_metadata",
                .message = fmt::format("metadata valve_type: the recording is of a valve of type '{}', the reference "
                                       "holds good valves of type '{}'",
                                       *type, options.reference->valve_type)};
    error.file = read.recording.name;
    error.field = "valve_type";
    error.found = *type;
    error.expected = options.reference->valve_type;
    return tl::unexpected(error);
  }
  return {};
}

std::vector<std::size_t> order_by_hash(const std::vector<ReadRecording>& recordings) {
  std::vector<std::size_t> order(recordings.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return recordings[a].sha256 < recordings[b].sha256; });
  return order;
}

}  // namespace

std::string settings_sha256(const AnalysisOptions& options, const ColumnMapping& mapping) {
  Json settings{{"baseline", options.baseline ? to_string(*options.baseline) : "auto"},
                {"reference", options.reference ? Json(options.reference->sha256) : Json(nullptr)},
                {"rule_base", options.rule_base ? Json(options.rule_base->sha256) : Json(nullptr)},
                {"columns", Json::array({mapping.time, mapping.input, mapping.output})},
                {"side", mapping.side},
                {"sample_rate_hz", or_null(mapping.sample_rate_hz)}};
  return canonical_sha256(settings);
}

Result<SessionAnalysis> analyze_session(std::vector<ReadRecording> recordings, const AnalysisOptions& options,
                                        const ColumnMapping& mapping) {
  if (auto checked = check_one_valve(recordings); !checked) return tl::unexpected(checked.error());
  if (auto checked = check_valve_type(recordings, options); !checked) return tl::unexpected(checked.error());
  SessionAnalysis session;
  session.order = order_by_hash(recordings);
  std::vector<Recording> ordered;
  for (const std::size_t place : session.order) ordered.push_back(std::move(recordings[place].recording));

  const auto begin = std::chrono::steady_clock::now();
  auto analysis = analyze(ordered, options);
  if (!analysis) return tl::unexpected(analysis.error());
  const std::chrono::duration<double> spent = std::chrono::steady_clock::now() - begin;

  session.analysis = std::move(*analysis);
  for (std::size_t i = 0; i < ordered.size(); ++i) {
    session.analysis.recordings[i].name = ordered[i].name;
    session.analysis.recordings[i].sha256 = recordings[session.order[i]].sha256;
    session.analysis.simulation.per_recording[i].name = ordered[i].name;
  }
  session.document = to_json(session.analysis, {.engine_version = VALVETRIAGE_VERSION,
                                                .settings_sha256 = settings_sha256(options, mapping),
                                                .timing_s = {{"analysis", spent.count()}}});
  session.recordings = std::move(ordered);
  return session;
}

}  // namespace valvetriage
