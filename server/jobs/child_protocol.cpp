#include "server/jobs/child_protocol.h"

#include <fmt/format.h>

#include <cstdio>
#include <iostream>
#include <iterator>
#include <new>

namespace valvetriage {
namespace {

Json to_json(const JobFile& file) {
  return {{"name", file.name},
          {"sha256", file.sha256},
          {"path", file.path},
          {"test", or_null(file.test)},
          {"metadata", file.metadata_json}};
}

JobFile file_from(JsonFields fields) {
  return {.name = fields.text("name"),
          .sha256 = fields.text("sha256"),
          .path = fields.text("path"),
          .test = fields.optional_text("test"),
          .metadata_json = fields.text("metadata")};
}

Json to_json(const Labels& labels) {
  return {{"lot", or_null(labels.lot)},
          {"serial", or_null(labels.serial)},
          {"valve_type", or_null(labels.valve_type)},
          {"condition", or_null(labels.condition)},
          {"stand", or_null(labels.stand)}};
}

Labels labels_from(JsonFields fields) {
  return {.lot = fields.optional_text("lot"),
          .serial = fields.optional_text("serial"),
          .valve_type = fields.optional_text("valve_type"),
          .condition = fields.optional_text("condition"),
          .stand = fields.optional_text("stand")};
}

Json to_json(const AnalysisSummary& summary) {
  Json errors = Json::array();
  for (const LevelError& level : summary.errors) {
    errors.push_back({{"level_A", level.level_a}, {"error_eq20", level.error_eq20}});
  }
  Json causes = Json::array();
  for (const CauseSummary& cause : summary.causes) {
    causes.push_back({{"cause", cause.cause}, {"probability", cause.probability}, {"settled", cause.settled}});
  }
  return {{"verdict", or_null(summary.verdict)},
          {"reason", or_null(summary.reason)},
          {"action", or_null(summary.action)},
          {"conclusion", or_null(summary.conclusion)},
          {"top_cause", or_null(summary.top_cause)},
          {"top_cause_probability", or_null(summary.top_cause_probability)},
          {"causes", std::move(causes)},
          {"errors", std::move(errors)},
          {"features", summary.features}};
}

AnalysisSummary summary_from(JsonFields fields) {
  AnalysisSummary summary;
  summary.verdict = fields.optional_text("verdict");
  summary.reason = fields.optional_text("reason");
  summary.action = fields.optional_text("action");
  summary.conclusion = fields.optional_text("conclusion");
  summary.top_cause = fields.optional_text("top_cause");
  summary.top_cause_probability = fields.optional_number("top_cause_probability");
  for (JsonFields cause : fields.objects("causes")) {
    CauseSummary entry{.cause = cause.text("cause"), .probability = cause.number("probability")};
    entry.settled = cause.flag("settled");
    summary.causes.push_back(std::move(entry));
  }
  for (JsonFields level : fields.objects("errors")) {
    const double level_a = level.number("level_A");
    summary.errors.push_back({level_a, level.number("error_eq20")});
  }
  summary.features = fields.number_by_name("features");
  return summary;
}

NewAnalysis analysis_from(JsonFields fields) {
  NewAnalysis analysis;
  analysis.engine_version = fields.text("engine_version");
  analysis.settings_sha256 = fields.text("settings_sha256");
  analysis.result_sha256 = fields.text("result_sha256");
  analysis.summary = summary_from(fields.object("summary"));
  analysis.body_json = fields.text("body");
  analysis.residuals_json = fields.text_or("residuals", "");
  return analysis;
}

void say(const std::string& line) {
  std::fwrite(line.data(), 1, line.size(), stdout);
  std::fflush(stdout);
}

Result<NewAnalysis> analyse_guarded(const AnalyseJob& analyse, const JobSpec& spec) {
  const auto report = [](double fraction, std::string_view note) { say(progress_line(fraction, note)); };
  try {
    return analyse(spec, report);
  } catch (const std::bad_alloc&) {
    return fail("out_of_memory", "the analysis needs more memory than one job may have");
  }
}

}  // namespace

std::string to_json_text(const JobSpec& spec) {
  Json files = Json::array();
  for (const JobFile& file : spec.files) files.push_back(to_json(file));
  return dump_json({{"job_id", spec.job_id},
                    {"submission_id", spec.submission_id},
                    {"files", std::move(files)},
                    {"labels", to_json(spec.labels)},
                    {"options", spec.options_json},
                    {"reference", or_null(spec.reference_json)},
                    {"rule_base", or_null(spec.rule_base_json)},
                    {"reference_version", spec.reference_version}});
}

Result<JobSpec> job_spec_from(std::string_view text) {
  const auto document = parse_json(text);
  if (!document) return tl::unexpected(document.error());
  std::optional<Error> error;
  JsonFields fields(*document, "", error);
  JobSpec spec;
  spec.job_id = fields.text("job_id");
  spec.submission_id = fields.text("submission_id");
  for (const JsonFields& file : fields.objects("files")) spec.files.push_back(file_from(file));
  spec.labels = labels_from(fields.object("labels"));
  spec.options_json = fields.text("options");
  spec.reference_json = fields.optional_text("reference");
  spec.rule_base_json = fields.optional_text("rule_base");
  spec.reference_version = fields.small_count("reference_version");
  if (error) return tl::unexpected(*error);
  return spec;
}

std::string progress_line(double fraction, std::string_view note) {
  return dump_json({{"progress", fraction}, {"note", std::string(note)}}) + "\n";
}

std::string done_line(const NewAnalysis& analysis) {
  return dump_json({{"done",
                     {{"engine_version", analysis.engine_version},
                      {"settings_sha256", analysis.settings_sha256},
                      {"result_sha256", analysis.result_sha256},
                      {"summary", to_json(analysis.summary)},
                      {"body", analysis.body_json},
                      {"residuals", analysis.residuals_json}}}}) +
         "\n";
}

std::string problem_json(const Error& error) {
  Json problem = {{"code", error.code}, {"detail", error.message}};
  if (!error.file.empty()) problem["file"] = error.file;
  if (error.line) problem["line"] = *error.line;
  if (error.column) problem["column"] = *error.column;
  if (!error.field.empty()) problem["field"] = error.field;
  if (!error.found.empty()) problem["found"] = error.found;
  if (!error.expected.empty()) problem["expected"] = error.expected;
  return dump_json(problem);
}

Json refusal_json(const Error& error) {
  return {{"code", error.code},          {"message", error.message},       {"file", error.file},
          {"field", error.field},        {"found", error.found},           {"expected", error.expected},
          {"line", or_null(error.line)}, {"column", or_null(error.column)}};
}

Error refusal_from(JsonFields fields) {
  Error error{.code = fields.text("code"), .message = fields.text("message")};
  error.file = fields.text("file");
  error.field = fields.text("field");
  error.found = fields.text("found");
  error.expected = fields.text("expected");
  if (fields.has("line")) error.line = fields.count("line");
  if (fields.has("column")) error.column = fields.count("column");
  return error;
}

std::string refused_line(const Error& error) {
  const char* what = error.code == kPassingFault ? "fault" : "rejected";
  return dump_json({{what, problem_json(error)}}) + "\n";
}

Result<ChildMessage> child_message_from(std::string_view line) {
  const auto document = parse_json(line);
  if (!document) return tl::unexpected(document.error());
  std::optional<Error> error;
  JsonFields fields(*document, "", error);
  ChildMessage message;
  if (fields.has("done")) {
    message.done = analysis_from(fields.object("done"));
  } else if (fields.has("rejected")) {
    message.rejected_json = fields.text("rejected");
  } else if (fields.has("fault")) {
    message.fault_json = fields.text("fault");
  } else {
    const double fraction = fields.number("progress");
    message.progress = ChildProgress{fraction, fields.text("note")};
  }
  if (error) return tl::unexpected(*error);
  return message;
}

int run_child(const AnalyseJob& analyse) {
  const std::string text{std::istreambuf_iterator<char>(std::cin), {}};
  const auto spec = job_spec_from(text);
  if (!spec) {
    fmt::print(stderr, "the job could not be read: {}\n", spec.error().message);
    return 1;
  }
  const auto analysis = analyse_guarded(analyse, *spec);
  say(analysis ? done_line(*analysis) : refused_line(analysis.error()));
  return 0;
}

}  // namespace valvetriage
