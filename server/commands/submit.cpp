#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <thread>

#include "core/recording/metadata.h"
#include "server/commands/commands.h"
#include "server/commands/progress_line.h"
#include "server/commands/recording_options.h"
#include "server/commands/server_options.h"
#include "server/http/client.h"
#include "server/http/request_head.h"
#include "server/http/submit_plan.h"
#include "server/wire/json.h"

namespace valvetriage {
namespace {

using http::Answer;

constexpr std::chrono::milliseconds kFirstPoll{100};
constexpr std::chrono::milliseconds kSlowestPoll{2000};

struct SubmitArguments {
  std::vector<std::string> files;
  ServerOptions server;
  RecordingOptions recordings;
  bool wait = false;
  bool as_json = false;
};

/// What became of one submission. `document` is the server's word on it, or the problem.
struct Outcome {
  http::PlannedSubmission plan;
  std::string route;  ///< of the submission or recording, empty when it was not accepted
  std::string job_id;
  Json document;
  ExitStatus status = kDone;
};

std::string upload_route(const SubmitArguments& arguments, const Metadata& labels, std::size_t files) {
  std::string route = files == 1 ? "/v1/recordings" : "/v1/submissions";
  char separator = '?';
  const auto add = [&](std::string_view name, const std::string& value) {
    route += fmt::format("{}{}={}", std::exchange(separator, '&'), name, http::percent_encode(value));
  };
  for (const MetadataKey& key : metadata_keys()) {
    if (const auto& value = labels.*key.field) add(key.name, *value);
  }
  const RecordingOptions& options = arguments.recordings;
  if (!options.columns.empty()) add("columns", options.columns);
  if (options.sample_rate_hz) add("sample_rate_hz", fmt::format("{}", *options.sample_rate_hz));
  return route;
}

Json problem_of(const Error& error) {
  Json problem{{"code", error.code}, {"detail", error.message}};
  if (!error.file.empty()) problem["file"] = error.file;
  return problem;
}

/// 4xx that tell of the input; anything else that is no success is the server's or the connection's failure.
bool is_bad_input(int status) {
  return status == 400 || status == 413 || status == 415 || status == 422;
}

Json body_of(const Answer& answer) {
  auto document = parse_json(answer.body);
  if (document && document->is_object()) return std::move(*document);
  return Json{{"code", "bad_answer"}, {"detail", fmt::format("the server answered {}", answer.status)}};
}

void refuse(Outcome& outcome, Json problem, ExitStatus status) {
  outcome.document = Json{{"state", status == kBadInput ? "rejected" : "failed"}, {"error", std::move(problem)}};
  outcome.status = status;
}

/// What was sent before and ended through no fault of the input is started again: to send it once more asks for that.
void start_again(http::Client& client, Outcome& outcome) {
  const std::string state = outcome.document.value("state", "");
  if (state != "failed" && state != "poisoned" && state != "cancelled") return;
  const auto answer = client.post(outcome.route + "/reanalyze", "");  // once: nothing tells a second one from a retry
  if (!answer || answer->status != 202) return;                       // what was there is told as it is
  outcome.job_id = body_of(*answer).value("id", "");
  outcome.document["job_id"] = outcome.job_id;
  outcome.document["state"] = "queued";
  outcome.document.erase("error");
}

Outcome send(http::Client& client, const SubmitArguments& arguments, const Metadata& labels,
             http::PlannedSubmission plan, const ProgressLine& progress) {
  Outcome outcome{.plan = std::move(plan), .route = {}, .job_id = {}, .document = {}};
  http::Upload upload{.path = upload_route(arguments, labels, outcome.plan.files.size()),
                      .files = outcome.plan.files,
                      .idempotency_key = {}};
  auto key = http::content_key(upload.path, upload.files);
  if (!key) {
    refuse(outcome, problem_of(key.error()), kBadInput);
    return outcome;
  }
  upload.idempotency_key = std::move(*key);
  const auto answer = http::with_retries({}, [&] {
    return client.upload(upload, [&](std::uint64_t bytes) {
      progress.show(fmt::format("{}: {} kB sent", outcome.plan.title, bytes / 1000));
    });
  });
  if (!answer) {
    refuse(outcome, problem_of(answer.error()), answer.error().code == "no_connection" ? kFailure : kBadInput);
  } else if (answer->status != 200 && answer->status != 202) {
    refuse(outcome, body_of(*answer), is_bad_input(answer->status) ? kBadInput : kFailure);
  } else {
    outcome.document = body_of(*answer);
    outcome.job_id = outcome.document.value("job_id", "");
    outcome.route = upload.path.substr(0, upload.path.find('?')) + "/" + outcome.document.value("id", "");
    start_again(client, outcome);
  }
  return outcome;
}

bool is_final_state(const std::string& state) {
  return state != "queued" && state != "running";
}

ExitStatus status_of(const Json& document) {
  const std::string state = document.value("state", "");
  if (state == "rejected") return kBadInput;
  if (state != "done") return kFailure;
  return document["verdict"] == "Good" ? kDone : kVerdictNotGood;
}

/// Polls until the submission's state is final.
void await(http::Client& client, Outcome& outcome, const ProgressLine& progress, const std::string& counter) {
  auto pause = kFirstPoll;
  for (;;) {
    const auto answer = http::with_retries({}, [&] { return client.get(outcome.route); });
    if (!answer) return refuse(outcome, problem_of(answer.error()), kFailure);
    if (answer->status != 200) return refuse(outcome, body_of(*answer), kFailure);
    outcome.document = body_of(*answer);
    const std::string state = outcome.document.value("state", "");
    if (is_final_state(state)) break;
    progress.show(fmt::format("{} {}: {}", counter, outcome.plan.title, state));
    std::this_thread::sleep_for(pause);
    pause = std::min(pause * 2, kSlowestPoll);
  }
  outcome.status = status_of(outcome.document);
}

std::string text_of(const Json& document, const char* name) {
  const auto found = document.find(name);
  return found != document.end() && found->is_string() ? found->get<std::string>() : "-";
}

void print_line(const Outcome& outcome) {
  const Json& document = outcome.document;
  const std::string serial = text_of(document, "serial");
  fmt::print("{}\t{}\t{}\t{}\t{}\n", text_of(document, "id"), serial == "-" ? outcome.plan.title : serial,
             text_of(document, "state"), text_of(document, "verdict"), text_of(document, "top_cause"));
  if (!document.contains("error") || !document["error"].is_object()) return;
  const Json& problem = document["error"];
  Error error{.code = text_of(problem, "code"), .message = text_of(problem, "detail")};
  error.file = problem.value("file", outcome.plan.title);
  print_error(error);
}

void print_json(const std::vector<Outcome>& outcomes) {
  Json submissions = Json::array();
  for (const Outcome& outcome : outcomes) {
    Json one{{"files", outcome.plan.files}};
    one.update(outcome.document);
    submissions.push_back(std::move(one));
  }
  fmt::print("{}\n", dump_json(Json{{"submissions", std::move(submissions)}}, true));
}

/// 1 before 2 before 3 before 0: the contract's order.
ExitStatus worst(const std::vector<Outcome>& outcomes) {
  for (const ExitStatus status : {kFailure, kBadInput, kVerdictNotGood}) {
    if (std::any_of(outcomes.begin(), outcomes.end(), [&](const Outcome& o) { return o.status == status; }))
      return status;
  }
  return kDone;
}

Result<std::vector<Outcome>> submit(const SubmitArguments& arguments) {
  const auto options = read_options(arguments.recordings);
  if (!options) return tl::unexpected(options.error());
  const Metadata& labels = options->metadata;
  auto client = open_client(arguments.server);
  if (!client) return tl::unexpected(client.error());
  auto plan = http::plan_submissions(arguments.files, labels, options->mapping);
  if (!plan) return tl::unexpected(plan.error());

  const ProgressLine progress;
  std::vector<Outcome> outcomes;
  for (http::PlannedSubmission& one : *plan)
    outcomes.push_back(send(*client, arguments, labels, std::move(one), progress));
  for (std::size_t i = 0; arguments.wait && i < outcomes.size(); ++i) {
    if (outcomes[i].route.empty()) continue;
    await(*client, outcomes[i], progress, fmt::format("{}/{}", i + 1, outcomes.size()));
  }
  return outcomes;
}

ExitStatus run(const SubmitArguments& arguments) {
  const auto outcomes = submit(arguments);
  if (!outcomes) {
    print_error(outcomes.error());
    return kBadInput;
  }
  if (arguments.as_json) print_json(*outcomes);
  for (const Outcome& outcome : *outcomes) {
    if (!arguments.as_json) print_line(outcome);
  }
  return worst(*outcomes);
}

}  // namespace

void add_submit_command(CLI::App& app, int& exit_status) {
  CLI::App* verb = app.add_subcommand("submit",
                                      "Send recordings to a server: files of one folder are one valve, other "
                                      "files are grouped by lot and serial");
  const auto arguments = std::make_shared<SubmitArguments>();
  verb->add_option("files", arguments->files, "Recordings or folders of recordings")->required();
  add_server_options(*verb, arguments->server)->required();
  add_metadata_options(*verb, arguments->recordings);
  add_column_options(*verb, arguments->recordings);
  verb->add_flag("--wait", arguments->wait, "Wait for the results; the exit status tells them");
  verb->add_flag("--json", arguments->as_json, "Print JSON");
  verb->callback([arguments, &exit_status] { exit_status = run(*arguments); });
}

}  // namespace valvetriage
