#include <fmt/format.h>

#include <cmath>

#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/report_response.h"
#include "server/http/stored_recording.h"
#include "server/http/subject.h"
#include "server/http/views.h"
#include "server/report/curves.h"
#include "server/report/valve_report.h"

namespace valvetriage::http {
namespace {

/// A report runs nothing and asks for nothing.
constexpr const char* kReportPolicy =
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

Result<AnalysisDocument> newest_document(Service& service, const SubmissionRow& submission) {
  const auto row = analysis_asked_for(service, submission);
  if (!row) return tl::unexpected(row.error());
  return stored_analysis(service, *row);
}

const Reference* pointer_to(const std::optional<Reference>& reference) {
  return reference ? &*reference : nullptr;
}

/// Null where nothing was added to the baseline.
const Model* extended_model(const Analysis& analysis) {
  const bool added = analysis.discrepancy && !analysis.discrepancy->causes.empty();
  return added ? &analysis.extended_model : nullptr;
}

/// reference  that of reference_to_show; null: none
Result<report::RecordingPlot> drawn(Service& service, const RecordingRow& row, const Analysis& analysis,
                                    const Reference* reference) {
  const auto recording = read_stored_recording(service, row);
  if (!recording) return tl::unexpected(recording.error());
  auto panels = report::recording_panels(*recording, analysis.baseline.model, extended_model(analysis), kReportPoints,
                                         report::tests_taken_off(analysis.baseline, reference));
  if (!panels) return tl::unexpected(panels.error());
  return report::RecordingPlot{.name = row.name,
                               .panels = std::move(*panels),
                               .stretches = report::recording_stretches(*recording, reference, kReportStretches),
                               .reason = {}};
}

report::RecordingPlot plot_of(Service& service, const RecordingRow& row, const Analysis& analysis,
                              const Reference* reference) {
  auto plot = drawn(service, row, analysis, reference);
  if (plot) return std::move(*plot);
  return {.name = row.name,
          .panels = {},
          .stretches = {},
          .reason = "This recording cannot be drawn: " + plot.error().message};
}

report::ReportSubject subject_of(const SubmissionRow& row) {
  const Labels& labels = row.labels;
  return {.serial = labels.serial.value_or(""),
          .lot = labels.lot.value_or(""),
          .valve_type = labels.valve_type.value_or(""),
          .stand = labels.stand.value_or(""),
          .condition = labels.condition.value_or(""),
          .received_at = format_rfc3339(row.received_at)};
}

}  // namespace

Response report_response(std::string html) {
  Response response;
  response.content_type = "text/html; charset=utf-8";
  response.body = std::move(html);
  response.set_header("Content-Security-Policy", kReportPolicy);
  response.set_header("Referrer-Policy", "no-referrer");
  return response;
}

Result<Response> get_report(Service& service, Request& request) {
  const auto submission = submission_asked_for(service, request);
  if (!submission) return tl::unexpected(submission.error());
  auto document = newest_document(service, *submission);
  if (!document) return tl::unexpected(document.error());
  const auto rows = service.store.recordings_of(submission->id);
  if (!rows) return tl::unexpected(rows.error());
  const auto place = PlaceForWork::take(service.computations);
  if (!place) return tl::unexpected(place.error());
  const auto reference = reference_to_show(service, document->analysis);
  if (!reference) return tl::unexpected(reference.error());
  report::ValveReport valve{.subject = subject_of(*submission), .analysis = std::move(*document), .plots = {}};
  for (const RecordingRow& row : *rows) {
    if (valve.plots.size() == kMaxReportPlots) break;
    valve.plots.push_back(plot_of(service, row, valve.analysis.analysis, pointer_to(*reference)));
  }
  return report_response(report::valve_report_html(valve));
}

Result<Response> get_plot(Service& service, Request& request) {
  const auto submission = submission_asked_for(service, request);
  if (!submission) return tl::unexpected(submission.error());
  const auto row = recording_asked_for(service, request);
  if (!row) return tl::unexpected(row.error());
  const auto document = newest_document(service, *submission);
  if (!document) return tl::unexpected(document.error());
  const auto place = PlaceForWork::take(service.computations);
  if (!place) return tl::unexpected(place.error());
  const auto reference = reference_to_show(service, document->analysis);
  if (!reference) return tl::unexpected(reference.error());
  const auto plot = drawn(service, *row, document->analysis, pointer_to(*reference));
  if (!plot) return tl::unexpected(plot.error());
  Response response;
  response.content_type = "image/svg+xml";
  response.body = report::time_plot(row->name, plot->panels, plot->stretches);
  response.set_header("Content-Security-Policy", kReportPolicy);
  return response;
}

}  // namespace valvetriage::http
