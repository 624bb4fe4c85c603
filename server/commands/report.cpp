#include <fmt/format.h>

#include <filesystem>
#include <memory>

#include "server/commands/analysis_arguments.h"
#include "server/commands/commands.h"
#include "server/commands/documents.h"
#include "server/commands/print_pdf.h"
#include "server/commands/progress_line.h"
#include "server/commands/recording_options.h"
#include "server/commands/server_options.h"
#include "server/http/client.h"
#include "server/http/limits.h"
#include "server/http/request_head.h"
#include "server/jobs/analyze_session.h"
#include "server/report/curves.h"
#include "server/report/valve_report.h"
#include "server/wire/json.h"

namespace valvetriage {
namespace {

struct ReportArguments {
  std::vector<std::string> subjects;  ///< one id, or files
  std::string lot;
  std::string output;
  bool pdf = false;
  AnalysisArguments compared;
  RecordingOptions recording;
  ServerOptions server;
};

bool is_id(const std::string& text) {
  std::error_code unreadable;
  return (text.starts_with("sub_") || text.starts_with("rec_")) && !std::filesystem::exists(text, unreadable);
}

/// Route of the report on the server; nothing where files are to be analysed here.
std::optional<std::string> route_of(const ReportArguments& arguments) {
  if (!arguments.lot.empty()) return "/v1/lots/" + http::percent_encode(arguments.lot) + "/report";
  if (arguments.subjects.size() != 1 || !is_id(arguments.subjects[0])) return std::nullopt;
  const char* kind = arguments.subjects[0].starts_with("sub_") ? "submissions" : "recordings";
  return fmt::format("/v1/{}/{}/report", kind, http::percent_encode(arguments.subjects[0]));
}

Result<std::string> fetched(const ReportArguments& arguments, const std::string& route) {
  if (arguments.server.url.empty()) return fail("bad_parameter", "a report of a stored result needs --server URL");
  auto client = open_client(arguments.server);
  if (!client) return tl::unexpected(client.error());
  auto answer = http::with_retries({}, [&] { return client->get(route); });
  if (!answer) return tl::unexpected(answer.error());
  if (answer->status == 200) return std::move(answer->body);
  const auto problem = parse_json(answer->body);
  const std::string code = problem ? problem->value("code", "refused") : "refused";
  return fail(code, problem ? problem->value("detail", "") : fmt::format("the server answered {}", answer->status));
}

report::ReportSubject subject_of(const Metadata& metadata) {
  return {.serial = metadata.serial.value_or(""),
          .lot = metadata.lot.value_or(""),
          .valve_type = metadata.valve_type.value_or(""),
          .stand = metadata.stand.value_or(""),
          .condition = metadata.condition.value_or(""),
          .received_at = {}};
}

report::RecordingPlot plot_of(const Recording& recording, const Analysis& analysis) {
  const bool added = analysis.discrepancy && !analysis.discrepancy->causes.empty();
  const auto& compared = analysis.baseline.reference;
  const Reference* reference = compared ? &*compared : nullptr;
  auto panels = report::recording_panels(recording, analysis.baseline.model, added ? &analysis.extended_model : nullptr,
                                         http::kReportPoints, report::tests_taken_off(analysis.baseline, reference));
  if (!panels) {
    return {.name = recording.name,
            .panels = {},
            .stretches = {},
            .reason = "This recording cannot be drawn: " + panels.error().message};
  }
  return {.name = recording.name,
          .panels = std::move(*panels),
          .stretches = report::recording_stretches(recording, reference, http::kReportStretches),
          .reason = {}};
}

Result<std::string> analysed(const ReportArguments& arguments) {
  auto options = analysis_options(arguments.compared);
  if (!options) return tl::unexpected(options.error());
  const auto reading = read_options(arguments.recording);
  if (!reading) return tl::unexpected(reading.error());
  const auto recordings = read_recordings(arguments.subjects, *reading);
  if (!recordings) return tl::unexpected(recordings.error());
  const ProgressLine progress;
  options->report = progress.stages();
  const auto session = analyze_session(*recordings, *options, reading->mapping);
  if (!session) return tl::unexpected(session.error());
  auto document = analysis_from_json(session->document);
  if (!document) return tl::unexpected(document.error());
  report::ValveReport report{
      .subject = subject_of(recordings->front().recording.metadata), .analysis = std::move(*document), .plots = {}};
  for (const std::size_t place : session->order) {
    if (report.plots.size() == http::kMaxReportPlots) break;
    report.plots.push_back(plot_of((*recordings)[place].recording, session->analysis));
  }
  return report::valve_report_html(report);
}

ExitStatus run(const ReportArguments& arguments) {
  if (arguments.subjects.empty() == arguments.lot.empty()) {
    return ended_by(Error{.code = "bad_parameter", .message = "give an id, files, or --lot"});
  }
  const auto route = route_of(arguments);
  const auto html = route ? fetched(arguments, *route) : analysed(arguments);
  if (!html) return ended_by(html.error());
  const auto written = arguments.pdf ? print_pdf(*html, arguments.output) : write_output(arguments.output, *html);
  return written ? kDone : ended_by(written.error());
}

}  // namespace

void add_report_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("report", "One self-contained page of a valve or a lot that prints to A4");
  const auto arguments = std::make_shared<ReportArguments>();
  verb->add_option("ID|FILE", arguments->subjects,
                   "A submission or recording on the server, or recordings of one valve to analyse here");
  verb->add_option("--lot", arguments->lot, "A lot on the server");
  verb->add_option("-o,--output", arguments->output, "Where the report goes")->required();
  verb->add_flag("--pdf", arguments->pdf, "Write PDF; needs Chromium");
  add_server_options(*verb, arguments->server);
  add_analysis_options(*verb, arguments->compared);
  add_column_options(*verb, arguments->recording);
  verb->callback([arguments, &exit_status] { exit_status = run(*arguments); });
}

}  // namespace valvetriage
