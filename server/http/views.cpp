#include "server/http/views.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <iterator>

#include "core/classify/verdict.h"
#include "core/mechanisms/mechanism.h"
#include "core/recording/text.h"
#include "server/http/limits.h"

namespace valvetriage::http {
namespace {

Json time_or_null(const std::optional<TimestampMs>& time) {
  return time ? Json(format_rfc3339(*time)) : Json(nullptr);
}

/// Stored JSON text was written by us; should it be damaged, the row is still shown.
Json stored_json(const std::optional<std::string>& text) {
  if (!text) return nullptr;
  auto parsed = parse_json(*text);
  return parsed ? std::move(*parsed) : Json(nullptr);
}

void add_labels(Json& object, const Labels& labels) {
  object["lot"] = or_null(labels.lot);
  object["serial"] = or_null(labels.serial);
  object["valve_type"] = or_null(labels.valve_type);
  object["condition"] = or_null(labels.condition);
}

void add_summary(Json& object, const AnalysisSummary& summary) {
  object["verdict"] = or_null(summary.verdict);
  object["reason"] = or_null(summary.reason);
  object["action"] = or_null(summary.action);
  object["conclusion"] = or_null(summary.conclusion);
  object["top_cause"] = or_null(summary.top_cause);
  object["top_cause_probability"] = or_null(summary.top_cause_probability);
}

Json links_of(const std::string& base, bool done) {
  Json links{{"self", base},
             {"raw", base + "/raw"},
             {"analyses", base + "/analyses"},
             {"series", base + "/series"},
             {"marks", base + "/marks"}};
  if (done) links["analysis"] = base + "/analysis";
  return links;
}

bool is_formula(std::string_view text) {
  return !text.empty() && std::string_view("=+-@\t\r").find(text.front()) != std::string_view::npos;
}

std::string csv_cell(const Json& value) {
  if (value.is_null()) return {};
  if (!value.is_string()) {
    const std::string text = dump_json(value);
    return value.is_structured() ? csv_cell(Json(text)) : text;
  }
  std::string text = value.get<std::string>();
  if (is_formula(text)) text.insert(0, 1, '\'');
  if (text.find_first_of("\",\r\n;") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted.append(c == '"' ? 2 : 1, c);
  return quoted + '"';
}

Error bad_filter(std::string_view name, std::string_view found, std::string expected) {
  Error error{.code = "bad_parameter"};
  error.field = name;
  error.found = found;
  error.expected = std::move(expected);
  error.message = fmt::format("{}: '{}' is not {}", name, found, error.expected);
  return error;
}

Result<TimestampMs> time_parameter(std::string_view name, std::string_view text) {
  if (const auto time = parse_rfc3339(text)) return *time;
  return tl::unexpected(bad_filter(name, text, "an RFC 3339 time, for instance 2026-08-03T09:12:44Z"));
}

/// A verdict or cause that cannot be would give an empty list, which reads like good news.
Result<void> check_filter_words(const Filter& filter) {
  const auto is_asked_for = [&](Verdict verdict) { return to_string(verdict) == *filter.verdict; };
  if (filter.verdict && std::ranges::none_of(kVerdicts, is_asked_for)) {
    return tl::unexpected(bad_filter("verdict", *filter.verdict, "Good, Malfunctioned or Severe"));
  }
  if (filter.cause && !find_mechanism(*filter.cause)) {
    return tl::unexpected(bad_filter("cause", *filter.cause, "a cause; /v1/causes lists them"));
  }
  return {};
}

/// One tag of an If-None-Match without the mark of a weak one, which compares alike here (RFC 9110, 13.1.2).
std::string_view strong(std::string_view tag) {
  tag = trim(tag);
  if (tag.starts_with("W/")) tag.remove_prefix(2);
  return tag;
}

/// Whether the client's If-None-Match holds this entity tag, quotes included.
bool has_tag(const Request& request, std::string_view tag) {
  std::string_view left = request.head.header("if-none-match").value_or("");
  if (strong(left) == "*") return true;
  while (!left.empty()) {
    const std::size_t comma = std::min(left.find(','), left.size());
    if (strong(left.substr(0, comma)) == tag) return true;
    left.remove_prefix(std::min(comma + 1, left.size()));
  }
  return false;
}

}  // namespace

bool is_known(const Request& request, std::string_view name, Response& response) {
  const std::string tag = fmt::format("\"{}\"", name);
  response.set_header("ETag", tag);
  if (!has_tag(request, tag)) return false;
  response.status = 304;
  return true;
}

Json view(const RecordingRow& row) {
  Json object{{"id", row.id},
              {"submission_id", row.submission_id},
              {"job_id", row.job_id},
              {"state", to_text(row.state)},
              {"received_at", format_rfc3339(row.received_at)},
              {"name", row.name},
              {"sha256", row.sha256},
              {"size_bytes", row.size_bytes}};
  add_labels(object, row.labels);
  object["test"] = or_null(row.test);
  object["stand"] = or_null(row.labels.stand);
  add_summary(object, row.summary);
  object["error"] = stored_json(row.problem_json);
  object["links"] = links_of("/v1/recordings/" + row.id, row.state == JobState::kDone);
  object["links"]["submission"] = "/v1/submissions/" + row.submission_id;
  object["links"]["job"] = "/v1/jobs/" + row.job_id;
  return object;
}

Json view(const SubmissionRow& row) {
  Json object{{"id", row.id},
              {"job_id", row.job_id},
              {"state", to_text(row.state)},
              {"received_at", format_rfc3339(row.received_at)}};
  add_labels(object, row.labels);
  object["stand"] = or_null(row.labels.stand);
  object["recordings"] = row.recordings;
  add_summary(object, row.summary);
  object["error"] = stored_json(row.problem_json);
  object["links"] = links_of("/v1/submissions/" + row.id, row.state == JobState::kDone);
  object["links"]["job"] = "/v1/jobs/" + row.job_id;
  return object;
}

Json view(const SubmissionRow& row, const std::vector<RecordingRow>& recordings) {
  Json object = view(row);
  object["recordings"] = Json::array();
  for (const RecordingRow& recording : recordings) object["recordings"].push_back(view(recording));
  return object;
}

Json view(const JobRow& row) {
  return Json{{"id", row.id},
              {"submission_id", row.submission_id},
              {"state", to_text(row.state)},
              {"created_at", format_rfc3339(row.created_at)},
              {"started_at", time_or_null(row.started_at)},
              {"finished_at", time_or_null(row.finished_at)},
              {"attempt", row.attempt},
              {"progress", row.progress},
              {"progress_note", row.progress_note},
              {"analysis_id", or_null(row.analysis_id)},
              {"error", stored_json(row.problem_json)},
              {"links", Json{{"self", "/v1/jobs/" + row.id}, {"submission", "/v1/submissions/" + row.submission_id}}}};
}

Json view(const AnalysisRow& row) {
  Json object{{"id", row.id},
              {"submission_id", row.submission_id},
              {"job_id", row.job_id},
              {"created_at", format_rfc3339(row.created_at)},
              {"engine_version", row.engine_version},
              {"settings_sha256", row.settings_sha256},
              {"result_sha256", row.result_sha256}};
  add_summary(object, row.summary);
  object["links"] = Json{{"self", "/v1/analyses/" + row.id}};
  return object;
}

Json view(const LotRow& row) {
  Json verdicts = Json::object(), causes = Json::object();
  for (const auto& [verdict, valves] : row.verdicts) verdicts[verdict.empty() ? "null" : verdict] = valves;
  for (const auto& [cause, valves] : row.causes) causes[cause] = valves;
  const std::string self = "/v1/lots/" + percent_encode(row.lot);
  return Json{{"lot", row.lot},
              {"first_received_at", format_rfc3339(row.first_received_at)},
              {"last_received_at", format_rfc3339(row.last_received_at)},
              {"recordings", row.recordings},
              {"submissions", row.submissions},
              {"valves", row.valves},
              {"analysed_valves", row.analysed_valves},
              {"verdicts", verdicts},
              {"causes", causes},
              {"links", Json{{"self", self}, {"history", self + "/history"}}}};
}

Json view(const FindingRow& row) {
  return Json{{"id", row.id},
              {"serial", row.serial},
              {"cause", row.cause},
              {"who", row.found_by},
              {"when", format_rfc3339(row.found_at)},
              {"note", row.note},
              {"created_at", format_rfc3339(row.created_at)}};
}

Json view(const DocumentRow& row) {
  const std::string_view kind = row.kind == DocumentKind::kReference ? "references" : "rule-bases";
  return Json{
      {"valve_type", row.valve_type},
      {"version", row.version},
      {"sha256", row.sha256},
      {"created_at", format_rfc3339(row.created_at)},
      {"created_by", row.created_by},
      {"links",
       Json{{"self", fmt::format("/v1/valve-types/{}/{}/{}", percent_encode(row.valve_type), kind, row.version)}}}};
}

Json view(const TokenRow& row) {
  return Json{{"id", row.id},
              {"name", row.name},
              {"scopes", row.scopes},
              {"created_at", format_rfc3339(row.created_at)},
              {"revoked_at", time_or_null(row.revoked_at)}};
}

Json view(const StandAlarm& alarm, const std::vector<SubmissionRow>& valves) {
  Json members = Json::array();
  for (const std::size_t i : alarm.valves) {
    members.push_back(Json{{"submission_id", valves[i].id},
                           {"serial", or_null(valves[i].labels.serial)},
                           {"lot", or_null(valves[i].labels.lot)},
                           {"received_at", format_rfc3339(valves[i].received_at)}});
  }
  return Json{
      {"stand", alarm.stand}, {"cause", alarm.cause}, {"current", alarm.current}, {"valves", std::move(members)}};
}

Response json_response(const Json& document, int status) {
  Response response;
  response.status = status;
  response.body = dump_json(document);
  return response;
}

Result<bool> wants_csv(const Request& request) {
  const std::string format = request.parameter("format");
  if (format.empty()) return request.head.header("accept").value_or("").starts_with("text/csv");
  if (format != "csv" && format != "json") return tl::unexpected(bad_filter("format", format, "csv or json"));
  return format == "csv";
}

Result<Response> list_response(const Request& request, std::vector<Json> items,
                               const std::optional<std::string>& next) {
  const auto csv = wants_csv(request);
  if (!csv) return tl::unexpected(csv.error());
  if (!*csv) return json_response(Json{{"items", std::move(items)}, {"next", or_null(next)}});
  Response response;
  response.content_type = fmt::format("text/csv; charset=utf-8; header={}", items.empty() ? "absent" : "present");
  response.body = to_csv(items);
  if (next) response.set_header("X-Next-Cursor", *next);
  response.set_header("Content-Disposition", "attachment; filename=\"list.csv\"");
  return response;
}

Result<Response> whole_list_response(const Request& request, std::vector<Json> items) {
  const auto page = page_request(request);
  if (!page) return tl::unexpected(page.error());
  std::size_t begin = 0;
  if (page->cursor) {
    const char* const last = page->cursor->data() + page->cursor->size();
    const auto [end, error] = std::from_chars(page->cursor->data(), last, begin);
    if (error != std::errc() || end != last || begin > items.size()) {
      return fail("invalid_cursor", "cursor is not one that an earlier page gave as 'next'");
    }
  }
  const std::size_t left = items.size() - begin;
  const bool is_bounded = request.head.parameter("limit").has_value();
  const std::size_t count = is_bounded ? std::min(left, static_cast<std::size_t>(page->limit)) : left;
  const auto first = items.begin() + static_cast<std::ptrdiff_t>(begin);
  std::vector<Json> shown(std::make_move_iterator(first),
                          std::make_move_iterator(first + static_cast<std::ptrdiff_t>(count)));
  const auto next = count < left ? std::optional(std::to_string(begin + count)) : std::nullopt;
  return list_response(request, std::move(shown), next);
}

Result<PageRequest> page_request(const Request& request) {
  PageRequest page{.limit = static_cast<int>(kDefaultPageItems), .cursor = std::nullopt};
  if (const auto text = request.head.parameter("limit")) {
    const auto [end, error] = std::from_chars(text->data(), text->data() + text->size(), page.limit);
    if (error != std::errc() || end != text->data() + text->size() || page.limit < 1 || page.limit > kMaxPageLimit) {
      Error bad{.code = "bad_parameter", .message = fmt::format("limit is a number from 1 to {}", kMaxPageLimit)};
      bad.field = "limit";
      bad.found = *text;
      return tl::unexpected(bad);
    }
  }
  if (const auto cursor = request.head.parameter("cursor")) page.cursor = std::string(*cursor);
  return page;
}

Result<Filter> filter_of(const Request& request) {
  Filter filter;
  const auto text = [&](std::string_view name) -> std::optional<std::string> {
    const auto value = request.head.parameter(name);
    return value && !value->empty() ? std::optional(std::string(*value)) : std::nullopt;
  };
  filter.lot = text("lot");
  filter.serial = text("serial");
  filter.valve_type = text("valve_type");
  filter.stand = text("stand");
  filter.verdict = text("verdict");
  filter.cause = text("cause");
  if (auto checked = check_filter_words(filter); !checked) return tl::unexpected(checked.error());
  for (const auto& [name, field] : {std::pair("since", &Filter::since), std::pair("until", &Filter::until)}) {
    const auto value = text(name);
    if (!value) continue;
    const auto time = time_parameter(name, *value);
    if (!time) return tl::unexpected(time.error());
    filter.*field = *time;
  }
  return filter;
}

std::string to_csv(const std::vector<Json>& items) {
  std::string out;
  if (items.empty()) return out;
  const auto add_row = [&](auto&& cell_of) {
    bool first = true;
    for (const auto& [name, value] : items.front().items()) {
      if (name == "links") continue;
      if (!std::exchange(first, false)) out += ',';
      out += cell_of(name);
    }
    out += "\r\n";
  };
  add_row([](const std::string& name) { return name; });
  for (const Json& item : items) {
    add_row([&](const std::string& name) { return item.contains(name) ? csv_cell(item[name]) : std::string(); });
  }
  return out;
}

}  // namespace valvetriage::http
