#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>

#include "core/mechanisms/simulate_extended.h"
#include "core/recording/quality.h"
#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/receive.h"
#include "server/http/stored_recording.h"
#include "server/http/subject.h"
#include "server/http/views.h"
#include "server/report/curves.h"
#include "server/report/downsample.h"
#include "server/wire/json_fields.h"
#include "server/wire/model_json.h"

namespace valvetriage::http {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kUniformTolerance = 1e-6;  // of a sample period: stamps written with six digits are uniform

enum class Shown { kInput, kMeasured, kSimulated, kExtended, kResidual, kExtendedResidual, kBode };

/// What part of which recording is asked for.
struct SeriesRequest {
  Shown what = Shown::kMeasured;
  std::string name;
  double from = -kInfinity;
  double to = kInfinity;
  std::size_t points = kDefaultSeriesPoints;
};

tl::unexpected<Error> bad_parameter(std::string_view name, std::string_view found, std::string expected) {
  Error error{.code = "bad_parameter"};
  error.message = fmt::format("{}: '{}' is not {}", name, found, expected);
  error.field = name;
  error.found = found;
  error.expected = std::move(expected);
  return tl::unexpected(error);
}

template <typename Number>
Result<void> read_number(const Request& request, std::string_view name, Number& number, const char* expected) {
  const auto text = request.head.parameter(name);
  if (!text) return {};
  const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), number);
  if (error != std::errc() || end != text->data() + text->size()) return bad_parameter(name, *text, expected);
  return {};
}

Result<SeriesRequest> series_request(const Request& request) {
  constexpr std::array kNames{std::pair("input", Shown::kInput),
                              std::pair("measured", Shown::kMeasured),
                              std::pair("simulated", Shown::kSimulated),
                              std::pair("extended", Shown::kExtended),
                              std::pair("residual", Shown::kResidual),
                              std::pair("extended_residual", Shown::kExtendedResidual),
                              std::pair("bode", Shown::kBode)};
  SeriesRequest wanted;
  wanted.name = request.parameter("what");
  if (wanted.name.empty()) wanted.name = "measured";
  const auto* found =
      std::find_if(kNames.begin(), kNames.end(), [&](const auto& entry) { return entry.first == wanted.name; });
  if (found == kNames.end())
    return bad_parameter("what", wanted.name,
                         "input, measured, simulated, extended, residual, extended_residual or bode");
  wanted.what = found->second;
  for (auto read : {read_number(request, "from", wanted.from, "a time in seconds"),
                    read_number(request, "to", wanted.to, "a time in seconds"),
                    read_number(request, "points", wanted.points, "a number of points")}) {
    if (!read) return tl::unexpected(read.error());
  }
  if (wanted.points < 2 || wanted.points > kMaxSeriesPoints) {
    return bad_parameter("points", std::to_string(wanted.points),
                         fmt::format("a number from 2 to {}", kMaxSeriesPoints));
  }
  return wanted;
}

Result<Json> newest_analysis(Service& service, const SubmissionRow& submission) {
  const auto row = analysis_asked_for(service, submission);
  if (!row) return tl::unexpected(row.error());
  const auto body = service.store.analysis_body(row->id);
  if (!body) return tl::unexpected(body.error());
  return parse_json(*body);
}

/// A model of the newest analysis: `extended_model`, or the baseline's.
Result<Model> stored_model(Service& service, const SubmissionRow& submission, bool extended) {
  const auto document = newest_analysis(service, submission);
  if (!document) return tl::unexpected(document.error());
  const Json& model = extended ? document->value("extended_model", Json())
                               : document->value("baseline", Json::object()).value("model", Json());
  if (!model.is_object()) return fail("not_available", "the analysis has no model to simulate");
  return model_from_json(model);
}

/// The tests on which what good valves leave belongs to the simulations of a submission.
Result<std::vector<KnownTest>> tests_taken_off(Service& service, const SubmissionRow& submission) {
  const auto row = analysis_asked_for(service, submission);
  if (!row) return tl::unexpected(row.error());
  const auto document = stored_analysis(service, *row);
  if (!document) return std::vector<KnownTest>{};
  const auto reference = reference_to_show(service, document->analysis);
  if (!reference) return tl::unexpected(reference.error());
  const auto known = report::tests_taken_off(document->analysis.baseline, *reference ? &**reference : nullptr);
  return std::vector<KnownTest>(known.begin(), known.end());
}

/// The whole series on the recording's grid; samples inside gaps are NaN.
Result<std::vector<double>> series_values(Service& service, const Request& request, const Recording& recording,
                                          Shown what) {
  if (what == Shown::kInput) return recording.input.values;
  std::vector<double> values = report::measured_output(recording);
  if (what == Shown::kMeasured) return values;
  const auto submission = submission_asked_for(service, request);
  if (!submission) return tl::unexpected(submission.error());
  const bool extended = what == Shown::kExtended || what == Shown::kExtendedResidual;
  const auto model = stored_model(service, *submission, extended);
  if (!model) return tl::unexpected(model.error());
  const auto known = tests_taken_off(service, *submission);
  if (!known) return tl::unexpected(known.error());
  auto simulated = report::free_run(*model, recording, *known);
  if (!simulated || what == Shown::kSimulated || what == Shown::kExtended) return simulated;
  for (std::size_t i = 0; i < values.size(); ++i) values[i] -= (*simulated)[i];
  return values;
}

/// The entry of the newest analysis's frequency_response that this recording is in.
Result<Json> stored_response(Service& service, const Request& request, const RecordingRow& row) {
  const auto submission = submission_asked_for(service, request);
  if (!submission) return tl::unexpected(submission.error());
  const auto document = newest_analysis(service, *submission);
  if (!document) return tl::unexpected(document.error());
  for (const Json& entry : document->value("frequency_response", Json::array())) {
    const Json recordings = entry.value("recordings", Json::array());
    if (std::find(recordings.begin(), recordings.end(), Json(row.sha256)) != recordings.end()) return entry;
  }
  return fail("not_available", "this recording holds no sweep, so its analysis has no frequency response of it");
}

/// what=bode: frequencies instead of times, as the analysis stored them.
Result<Response> bode_response(Service& service, Request& request, const RecordingRow& row) {
  auto entry = stored_response(service, request, row);
  if (!entry) return tl::unexpected(entry.error());
  const auto csv = wants_csv(request);
  if (!csv) return tl::unexpected(csv.error());
  if (*csv) {
    std::vector<Json> rows;
    const auto at = [&](const char* name, std::size_t i) { return (*entry)[name][i]; };
    for (std::size_t i = 0; i < (*entry)["frequency_hz"].size(); ++i) {
      rows.push_back(Json{{"frequency_hz", at("frequency_hz", i)},
                          {"gain", at("gain", i)},
                          {"gain_normalised", at("gain_normalised", i)},
                          {"phase_deg", at("phase_deg", i)},
                          {"coherence", at("coherence", i)},
                          {"band95_low", at("band95", i)[0]},
                          {"band95_high", at("band95", i)[1]}});
    }
    return list_response(request, std::move(rows), std::nullopt);
  }
  (*entry)["recording_id"] = row.id;
  (*entry)["what"] = "bode";
  return json_response(*entry);
}

std::string_view to_text(SegmentKind kind) {
  switch (kind) {
    case SegmentKind::kStep:
      return "step";
    case SegmentKind::kRamp:
      return "ramp";
    case SegmentKind::kSweep:
      return "sweep";
    case SegmentKind::kHold:
      break;
  }
  return "hold";
}

/// Input and, where given, output of POST /v1/simulations, on a uniform grid.
Result<Recording> simulation_input(JsonFields fields) {
  Recording recording;
  recording.time_s = fields.numbers("time_s");
  recording.input.values = fields.numbers("values");
  if (fields.has("output")) recording.output.values = fields.numbers("output");
  if (!fields.ok()) return recording;
  const std::size_t n = recording.time_s.size();
  if (n < 2 || recording.input.values.size() != n ||
      (!recording.output.values.empty() && recording.output.values.size() != n)) {
    fields.refuse("time_s", "ragged_columns", "time_s, values and output are equally long, at least two samples");
    return recording;
  }
  recording.start_s = recording.time_s.front();
  recording.sample_period_s = (recording.time_s.back() - recording.start_s) / static_cast<double>(n - 1);
  for (std::size_t i = 0; i < n; ++i) {
    const double grid = recording.start_s + static_cast<double>(i) * recording.sample_period_s;
    if (!(recording.sample_period_s > 0) ||
        std::abs(recording.time_s[i] - grid) > kUniformTolerance * recording.sample_period_s) {
      fields.refuse("time_s", "time_not_increasing", "has to increase by the same step everywhere");
      break;
    }
  }
  if (recording.output.values.empty()) recording.output.values.assign(n, std::nan(""));
  return recording;
}

Result<Model> model_asked_for(Service& service, const Json& document) {
  if (document.contains("model")) return model_from_json(document["model"]);
  std::optional<Error> error;
  const std::string id = JsonFields(document, "", error).text_or("submission", "");
  if (error) return tl::unexpected(*error);
  if (id.empty())
    return fail("missing_field", "either 'model' (a document) or 'submission' (an id) says what to simulate");
  const auto submission = service.store.submission(id);
  if (!submission) return tl::unexpected(submission.error());
  return stored_model(service, *submission, true);
}

/// Nothing before there is an analysis: places in the samples alone are marked then.
Result<std::optional<Reference>> reference_of_marks(Service& service, const Request& request) {
  const auto submission = submission_asked_for(service, request);
  if (!submission) return tl::unexpected(submission.error());
  const auto row = service.store.newest_analysis(submission->id);
  if (!row && row.error().code == "not_found") return std::nullopt;
  if (!row) return tl::unexpected(row.error());
  const auto document = stored_analysis(service, *row);
  if (!document) return std::nullopt;
  return reference_to_show(service, document->analysis);
}

}  // namespace

Result<Response> get_series(Service& service, Request& request) {
  const auto wanted = series_request(request);
  if (!wanted) return tl::unexpected(wanted.error());
  const auto row = recording_asked_for(service, request);
  if (!row) return tl::unexpected(row.error());
  if (wanted->what == Shown::kBode) return bode_response(service, request, *row);
  const auto place = PlaceForWork::take(service.computations);
  if (!place) return tl::unexpected(place.error());
  const auto recording = read_stored_recording(service, *row);
  if (!recording) return tl::unexpected(recording.error());
  const auto values = series_values(service, request, *recording, wanted->what);
  if (!values) return tl::unexpected(values.error());
  const report::Points shown =
      report::downsample(report::grid_times(*recording), *values, wanted->from, wanted->to, wanted->points);
  const Channel& channel = wanted->what == Shown::kInput ? recording->input : recording->output;
  const auto csv = wants_csv(request);
  if (!csv) return tl::unexpected(csv.error());
  if (*csv) {
    std::vector<Json> rows;
    for (std::size_t i = 0; i < shown.value.size(); ++i) {
      rows.push_back(Json{{"time_s", shown.time_s[i]}, {wanted->name, shown.value[i]}});
    }
    return list_response(request, std::move(rows), std::nullopt);
  }
  return json_response(Json{{"recording_id", row->id},
                            {"what", wanted->name},
                            {"unit", channel.unit},
                            {"samples", values->size()},
                            {"time_s", shown.time_s},
                            {"values", shown.value}});
}

Result<Response> get_marks(Service& service, Request& request) {
  const auto row = recording_asked_for(service, request);
  if (!row) return tl::unexpected(row.error());
  const auto place = PlaceForWork::take(service.computations);
  if (!place) return tl::unexpected(place.error());
  const auto recording = read_stored_recording(service, *row);
  if (!recording) return tl::unexpected(recording.error());
  const auto time = [&](std::size_t i) {
    return recording->start_s + static_cast<double>(i) * recording->sample_period_s;
  };
  Json segments = Json::array(), quality = Json::array();
  for (const Segment& segment : recording->segments) {
    if (segments.size() == kMaxMarks) break;
    segments.push_back(Json{{"kind", to_text(segment.kind)},
                            {"name", report::segment_name(segment, recording->input.unit)},
                            {"from_s", time(segment.begin)},
                            {"to_s", time(segment.end)},
                            {"level", segment.level},
                            {"from_level", segment.from_level},
                            {"rate_per_s", segment.rate_per_s}});
  }
  const auto reference = reference_of_marks(service, request);
  if (!reference) return tl::unexpected(reference.error());
  for (const QualityPlace& found : report::marked_places(*recording, *reference ? &**reference : nullptr)) {
    if (quality.size() == kMaxMarks) break;
    quality.push_back(Json{{"code", found.code}, {"from_s", time(found.begin)}, {"to_s", time(found.end)}});
  }
  return json_response(Json{{"recording_id", row->id},
                            {"unit", recording->input.unit},
                            {"segments", std::move(segments)},
                            {"quality", std::move(quality)}});
}

Result<Response> post_simulation(Service& service, Request& request) {
  const auto document = receive_json(request, kMaxDocumentBytes);
  if (!document) return tl::unexpected(document.error());
  // Not before the document is there: whoever sends it slowly would hold a place from all others.
  const auto place = PlaceForWork::take(service.computations);
  if (!place) return tl::unexpected(place.error());
  const auto model = model_asked_for(service, *document);
  if (!model) return tl::unexpected(model.error());
  std::optional<Error> error;
  JsonFields fields(*document, "", error);
  InitialState initial;
  if (fields.has("initial_samples")) initial.samples = fields.count("initial_samples");
  if (initial.samples != 0) initial.kind = InitialState::Kind::kMeasured;
  const auto input = simulation_input(fields.object("input"));
  if (error) return tl::unexpected(*error);
  if (!input) return tl::unexpected(input.error());
  const auto output = simulate_extended(*model, *input, initial);
  if (!output) return tl::unexpected(output.error());
  return json_response(Json{{"time_s", input->time_s},
                            {"input", input->input.values},
                            {"output_simulated", *output},
                            {"input_unit", model->input_unit},
                            {"output_unit", model->output_unit}});
}

}  // namespace valvetriage::http
