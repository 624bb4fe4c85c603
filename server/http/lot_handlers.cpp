#include <fmt/format.h>

#include <cmath>
#include <iterator>

#include "core/recording/metadata.h"
#include "core/recording/text.h"
#include "server/http/handlers.h"
#include "server/http/limits.h"
#include "server/http/lot_history.h"
#include "server/http/lot_shifts.h"
#include "server/http/lot_sizes.h"
#include "server/http/receive.h"
#include "server/http/report_response.h"
#include "server/http/stored_history.h"
#include "server/http/stored_patterns.h"
#include "server/http/stored_recording.h"
#include "server/http/views.h"
#include "server/report/lot_report.h"
#include "server/wire/json_fields.h"

namespace valvetriage::http {
namespace {

constexpr std::size_t kMaxValveSubmissions = 1'000;  // one valve, tested daily for three years
constexpr std::size_t kMaxFindingBytes = 64 * 1024;
constexpr std::size_t kMaxNoteBytes = 10'000;
constexpr std::size_t kMaxSerialBytes = 200;

std::string text_or_null(const std::optional<std::string>& text) {
  return text ? dump_json(Json(*text)) : "null";
}

std::string number_or_null(const std::optional<double>& number) {
  return number && std::isfinite(*number) ? fmt::format("{}", *number) : "null";
}

/// Written without a document in between: a lot has ten thousand of these, and the page waits for them.
void add_valve_point(std::string& out, const SubmissionRow& row, const std::vector<double>& q_values) {
  const Labels& labels = row.labels;
  const AnalysisSummary& summary = row.summary;
  fmt::format_to(std::back_inserter(out),
                 R"({{"submission_id":{},"serial":{},"stand":{},"received_at":"{}","verdict":{},"conclusion":{},)"
                 R"("top_cause":{},"top_cause_probability":{},"causes":[)",
                 dump_json(Json(row.id)), text_or_null(labels.serial), text_or_null(labels.stand),
                 format_rfc3339(row.received_at), text_or_null(summary.verdict), text_or_null(summary.conclusion),
                 text_or_null(summary.top_cause), number_or_null(summary.top_cause_probability));
  const std::vector<CauseSummary> causes = settled_causes(row);
  for (std::size_t i = 0; i < causes.size(); ++i) {
    fmt::format_to(std::back_inserter(out), R"({}{{"cause":{},"probability":{},"q_value":{}}})", i == 0 ? "" : ",",
                   dump_json(Json(causes[i].cause)), number_or_null(causes[i].probability),
                   number_or_null(q_values[i]));
  }
  out += R"(],"errors":[)";
  for (std::size_t i = 0; i < summary.errors.size(); ++i) {
    fmt::format_to(std::back_inserter(out), R"({}{{"level_A":{},"error_eq20":{}}})", i == 0 ? "" : ",",
                   number_or_null(summary.errors[i].level_a), number_or_null(summary.errors[i].error_eq20));
  }
  out += R"(],"features":{)";
  for (auto feature = summary.features.begin(); feature != summary.features.end(); ++feature) {
    fmt::format_to(std::back_inserter(out), R"({}{}:{})", feature == summary.features.begin() ? "" : ",",
                   dump_json(Json(feature->first)), number_or_null(feature->second));
  }
  out += "}}";
}

/// What a control chart of one figure needs.
Json figure_view(const FigureHistory& figure, const std::vector<SubmissionRow>& valves) {
  Json object{{"valves", figure.values.size()},
              {"centre", nullptr},
              {"upper_limit", nullptr},
              {"lower_limit", nullptr},
              {"outside", Json::array()}};
  if (!figure.limits) return object;
  object["centre"] = figure.limits->centre;
  object["upper_limit"] = figure.limits->upper;
  object["lower_limit"] = figure.limits->lower;
  for (std::size_t i = 0; i < figure.values.size(); ++i) {
    if (figure.values[i] > figure.limits->upper || figure.values[i] < figure.limits->lower) {
      object["outside"].push_back(valves[figure.valves[i]].id);
    }
  }
  return object;
}

Result<report::LotReportValve> reported_valve(Store& store, const SubmissionRow& row,
                                              const std::vector<double>& q_values) {
  const auto analysis = store.newest_analysis(row.id);
  if (!analysis) return tl::unexpected(analysis.error());
  report::LotReportValve valve{.serial = row.labels.serial.value_or(""),
                               .received_at = format_rfc3339(row.received_at),
                               .verdict = row.summary.verdict.value_or(""),
                               .conclusion = row.summary.conclusion.value_or(""),
                               .names = {},
                               .likely = row.summary.top_cause.value_or(""),
                               .likely_probability = row.summary.top_cause_probability.value_or(std::nan("")),
                               .error_eq20 = {},
                               .engine_version = analysis->engine_version,
                               .settings_sha256 = analysis->settings_sha256,
                               .result_sha256 = analysis->result_sha256,
                               .inputs = {}};
  const auto recordings = store.recordings_of(row.id);
  if (!recordings) return tl::unexpected(recordings.error());
  for (const RecordingRow& recording : *recordings) valve.inputs.emplace_back(recording.name, recording.sha256);
  const std::vector<CauseSummary> causes = settled_causes(row);
  for (std::size_t i = 0; i < causes.size(); ++i) {
    valve.names.push_back({causes[i].cause, causes[i].probability, q_values[i]});
  }
  for (const LevelError& error : row.summary.errors) valve.error_eq20[error.level_a] = error.error_eq20;
  return valve;
}

report::LotReportLevel reported_level(double level_a, const FigureHistory& level,
                                      const std::vector<SubmissionRow>& valves) {
  report::LotReportLevel shown{.level_a = level_a, .points = {}, .limits = std::nullopt};
  if (level.limits) shown.limits = {level.limits->centre, level.limits->lower, level.limits->upper};
  for (std::size_t i = 0; i < level.values.size(); ++i) {
    const double error = level.values[i];
    const bool outside = level.limits && (error > level.limits->upper || error < level.limits->lower);
    const std::string verdict = valves[level.valves[i]].summary.verdict.value_or("");
    shown.points.push_back({.value = error, .verdict = verdict, .outside = outside});
  }
  return shown;
}

std::string serial_of(const SubmissionRow& valve) {
  return valve.labels.serial.value_or("without serial");
}

report::Panel residual_panel(const GroupResidual& residual) {
  const auto curve = [&](const char* name, report::Ink ink, double deviations) {
    report::Curve line{.name = name, .ink = ink, .x = residual.time_s, .y = residual.mean};
    for (std::size_t i = 0; i < line.y.size(); ++i) line.y[i] += deviations * residual.sd[i];
    return line;
  };
  report::Panel panel{.title = "Residual, " + residual.test, .height = 150, .curves = {}};
  panel.curves = {curve("mean", report::Ink::kSimulated, 0), curve("less 1 sd", report::Ink::kInput, -1),
                  curve("plus 1 sd", report::Ink::kInput, 1)};
  if (!residual.good.empty()) {
    panel.curves.push_back(
        {.name = "good valves", .ink = report::Ink::kMeasured, .x = residual.time_s, .y = residual.good});
  }
  return panel;
}

report::PatternsShown shown_patterns(const StoredPatterns& patterns) {
  report::PatternsShown shown{
      .unexplained = patterns.unexplained, .compared = patterns.compared.size(), .groups = {}, .alone = {}};
  for (const LotPattern& pattern : patterns.groups) {
    report::PatternShown& group = shown.groups.emplace_back();
    for (const std::size_t member : pattern.members) group.members.push_back(serial_of(*patterns.compared[member]));
    for (const GroupResidual& residual : pattern.residuals) group.panels.push_back(residual_panel(residual));
  }
  for (const SubmissionRow* valve : patterns.alone()) shown.alone.push_back(serial_of(*valve));
  return shown;
}

Result<NewFinding> finding_of(const Json& document, const Request& request) {
  Metadata named;
  if (auto sound = set_metadata(named, "serial", request.captures[0]); !sound) return tl::unexpected(sound.error());
  std::optional<Error> error;
  JsonFields fields(document, "", error);
  NewFinding finding{.serial = request.captures[0],
                     .cause = fields.text("cause"),
                     .found_by = fields.text("who"),
                     .found_at = std::nullopt,
                     .note = fields.text_or("note", ""),
                     .actor = request.actor};
  if (const auto when = fields.optional_text("when")) {
    finding.found_at = parse_rfc3339(*when);
    if (!finding.found_at) fields.refuse("when", "bad_time", "is not an RFC 3339 time");
  }
  for (const auto& [name, text, most] :
       {std::tuple("cause", &finding.cause, kMaxSerialBytes), std::tuple("who", &finding.found_by, kMaxSerialBytes),
        std::tuple("note", &finding.note, kMaxNoteBytes)}) {
    if (text->size() > most) fields.refuse(name, "too_long", fmt::format("is longer than {} bytes", most));
  }
  if (error) return tl::unexpected(*error);
  return finding;
}

}  // namespace

Result<Response> list_lots(Service& service, Request& request) {
  const auto page = page_request(request);
  if (!page) return tl::unexpected(page.error());
  const auto rows = service.store.list_lots(*page);
  if (!rows) return tl::unexpected(rows.error());
  std::vector<Json> items;
  for (const LotRow& row : rows->items) items.push_back(view(row));
  return list_response(request, std::move(items), rows->next);
}

Result<Response> get_lot(Service& service, Request& request) {
  const auto row = service.store.lot(request.captures[0]);
  if (!row) return tl::unexpected(row.error());
  return json_response(view(*row));
}

Result<Response> get_lot_history(Service& service, Request& request) {
  const auto lot = service.store.lot(request.captures[0]);
  if (!lot) return tl::unexpected(lot.error());
  const auto history = stored_history(service.store, {.lot = lot->lot});
  if (!history) return tl::unexpected(history.error());
  Json levels = Json::array(), features = Json::array(), alarms = Json::array();
  for (const auto& [level_a, level] : history->levels) {
    levels.push_back(figure_view(level, history->valves));
    levels.back()["level_A"] = level_a;
  }
  for (const auto& [name, feature] : history->features) {
    features.push_back(figure_view(feature, history->valves));
    features.back()["name"] = name;
  }
  for (const StandAlarm& alarm : stand_alarms(history->valves)) alarms.push_back(view(alarm, history->valves));
  const Json counted = view(*lot);
  Response response = json_response(Json{{"lot", lot->lot},
                                         {"verdicts", counted["verdicts"]},
                                         {"causes", counted["causes"]},
                                         {"levels", std::move(levels)},
                                         {"features", std::move(features)},
                                         {"alarms", std::move(alarms)}});
  response.body.back() = ',';
  response.body += R"("valves":[)";
  const std::vector<std::vector<double>> q_values = name_q_values(history->valves);
  for (std::size_t i = 0; i < history->valves.size(); ++i) {
    if (i > 0) response.body += ',';
    add_valve_point(response.body, history->valves[i], q_values[i]);
  }
  response.body += "]}";
  return response;
}

Result<Response> get_lot_report(Service& service, Request& request) {
  const auto lot = service.store.lot(request.captures[0]);
  if (!lot) return tl::unexpected(lot.error());
  const auto history = stored_history(service.store, {.lot = lot->lot});
  if (!history) return tl::unexpected(history.error());
  report::LotReport report{.lot = lot->lot,
                           .first_received_at = format_rfc3339(lot->first_received_at),
                           .last_received_at = format_rfc3339(lot->last_received_at),
                           .valves = {},
                           .levels = {},
                           .shifts = {},
                           .sizes = {},
                           .patterns = {}};
  const std::vector<std::vector<double>> q_values = name_q_values(history->valves);
  for (std::size_t i = 0; i < history->valves.size(); ++i) {
    auto valve = reported_valve(service.store, history->valves[i], q_values[i]);
    if (!valve) return tl::unexpected(valve.error());
    report.valves.push_back(std::move(*valve));
  }
  auto shifts = lot_shifts(service.store, *history);
  if (!shifts) return tl::unexpected(shifts.error());
  report.shifts = std::move(*shifts);
  auto sizes = lot_sizes(service.store, *history);
  if (!sizes) return tl::unexpected(sizes.error());
  report.sizes = std::move(*sizes);
  const auto place = PlaceForWork::take(service.computations);
  if (!place) return tl::unexpected(place.error());
  const auto patterns = stored_patterns(service, *history);
  if (!patterns) return tl::unexpected(patterns.error());
  report.patterns = shown_patterns(*patterns);
  for (const auto& [level_a, level] : history->levels) {
    report.levels.push_back(reported_level(level_a, level, history->valves));
  }
  return report_response(report::lot_report_html(report));
}

Result<Response> get_valve(Service& service, Request& request) {
  Filter filter;
  filter.serial = request.captures[0];
  const auto submissions = all_submissions(service.store, filter, kMaxValveSubmissions);
  if (!submissions) return tl::unexpected(submissions.error());
  const auto findings = service.store.findings(*filter.serial);
  if (!findings) return tl::unexpected(findings.error());
  if (submissions->empty() && findings->empty())
    return fail("not_found", fmt::format("no recording and no finding names the serial '{}'", *filter.serial));
  Json document{{"serial", *filter.serial}, {"submissions", Json::array()}, {"findings", Json::array()}};
  for (const SubmissionRow& row : *submissions) document["submissions"].push_back(view(row));
  for (const FindingRow& row : *findings) document["findings"].push_back(view(row));
  return json_response(document);
}

Result<Response> post_finding(Service& service, Request& request) {
  const auto document = receive_json(request, kMaxFindingBytes);
  if (!document) return tl::unexpected(document.error());
  const auto finding = finding_of(*document, request);
  if (!finding) return tl::unexpected(finding.error());
  const auto row = service.store.add_finding(*finding);
  if (!row) return tl::unexpected(row.error());
  Response response = json_response(view(*row), 201);
  response.set_header("Location", "/v1/valves/" + percent_encode(row->serial));
  return response;
}

}  // namespace valvetriage::http
