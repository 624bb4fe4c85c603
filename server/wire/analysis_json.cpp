#include "server/wire/analysis_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "server/wire/canonical_json.h"
#include "server/wire/discrepancy_json.h"
#include "server/wire/frequency_json.h"
#include "server/wire/json_fields.h"
#include "server/wire/model_json.h"

namespace valvetriage {
namespace {

constexpr const char* kAnalysisSchema = "valvetriage.analysis/1";

constexpr std::array<std::pair<BaselineKind, const char*>, 3> kBaselineKinds{
    {{BaselineKind::kReference, "reference"}, {BaselineKind::kSelf, "self"}, {BaselineKind::kPaper, "paper"}}};

constexpr std::array<std::pair<NoVerdict, const char*>, 6> kNoVerdicts{{{NoVerdict::kNoRuleBase, "no_rule_base"},
                                                                        {NoVerdict::kUnits, "units"},
                                                                        {NoVerdict::kLevelMissing, "level_missing"},
                                                                        {NoVerdict::kSelfBaseline, "self_baseline"},
                                                                        {NoVerdict::kUnstable, "unstable"},
                                                                        {NoVerdict::kFeedback, "feedback"}}};

template <typename Table, typename Value>
std::string name_in(const Table& table, Value value) {
  for (const auto& [entry, name] : table) {
    if (entry == value) return name;
  }
  return {};
}

template <typename Value, std::size_t n>
std::optional<Value> value_in(const std::array<std::pair<Value, const char*>, n>& table, const std::string& wanted) {
  for (const auto& [entry, name] : table) {
    if (wanted == name) return entry;
  }
  return std::nullopt;
}

Json by_name(const std::map<std::string, double>& values) {
  Json object = Json::object();
  for (const auto& [name, value] : values) object[name] = finite_or_null(value);
  return object;
}

Json to_json(const QualityItem& item) {
  return Json{{"code", item.code}, {"detail", item.detail}, {"count", item.count}};
}

Json to_json(const RecordingSummary& recording) {
  return Json{{"name", recording.name},
              {"sha256", recording.sha256},
              {"samples", recording.samples},
              {"sample_rate_hz", finite_or_null(recording.sample_rate_hz)},
              {"test", to_string(recording.test)},
              {"quality", list_to_json(recording.quality, to_json)}};
}

Json to_json(const Baseline& baseline) {
  Json reference = nullptr;
  if (baseline.reference) {
    reference = Json{{"valve_type", baseline.reference->valve_type},
                     {"version", baseline.reference->version},
                     {"sha256", baseline.reference->sha256},
                     {"valves", baseline.reference->valves}};
    if (baseline.on_known_tests) reference["on_known_tests"] = true;
  }
  return Json{{"kind", to_string(baseline.kind)},
              {"reason", baseline.reason},
              {"reference", reference},
              {"model", to_json(baseline.model)}};
}

Json to_json(const LevelFigures& level) {
  return Json{{"level_A", finite_or_null(level.level_a)},
              {"error_eq20", finite_or_null(level.error_eq20)},
              {"error_eq20_own_fit", finite_or_null(level.error_eq20_own)},
              {"settling_error", finite_or_null(level.settling_error)},
              {"rise_time_s", finite_or_null(level.rise_time_s)},
              {"bandwidth_hz", finite_or_null(level.bandwidth_hz)}};
}

Json to_json(const RecordingFigures& figures) {
  return Json{{"name", figures.name},
              {"rmse", finite_or_null(figures.rmse)},
              {"fit_percent", finite_or_null(figures.fit_percent)},
              {"noise_floor", finite_or_null(figures.noise_floor)}};
}

Json to_json(const Simulation& simulation) {
  return Json{{"rmse", finite_or_null(simulation.rmse)},
              {"fit_percent", finite_or_null(simulation.fit_percent)},
              {"noise_floor", finite_or_null(simulation.noise_floor)},
              {"window", Json{{"rate_hz", simulation.window.rate_hz}, {"duration_s", simulation.window.duration_s}}},
              {"by_level", list_to_json(simulation.by_level, to_json)},
              {"per_recording", list_to_json(simulation.per_recording, to_json)},
              {"cross_domain_rmse", finite_or_null(simulation.cross_domain_rmse)}};
}

Json frequency_response_json(const Analysis& analysis) {
  Json list = Json::array();
  for (const FrequencyResult& result : analysis.frequency_response)
    list.push_back(to_json(result, analysis.recordings));
  return list;
}

Json to_json(const LevelVerdict& level) {
  Json rules = Json::array();
  for (const auto& [rule, strength] : level.rules) {
    rules.push_back(Json{{"rule", rule}, {"strength", finite_or_null(strength)}});
  }
  return Json{{"verdict", level.verdict}, {"memberships", by_name(level.memberships)}, {"rules", rules}};
}

Json to_json(const ClassificationResult& result) {
  Json per_level = Json::object();
  for (const LevelVerdict& level : result.per_level) per_level[level.level] = to_json(level);
  Json rule_base = nullptr;
  if (!result.rule_base_name.empty()) {
    rule_base = Json{
        {"name", result.rule_base_name}, {"version", result.rule_base_version}, {"sha256", result.rule_base_sha256}};
  }
  return Json{{"verdict", or_null(result.verdict)},
              {"reason", result.reason ? Json(to_string(*result.reason)) : Json(nullptr)},
              {"explanation", result.explanation},
              {"action", result.action},
              {"memberships", by_name(result.memberships)},
              {"per_level", per_level},
              {"rule_base", rule_base},
              {"without_stand_causes", or_null(result.without_stand_causes)}};
}

/// A number that is null where it was not finite.
double number_or_nan(JsonFields& fields, const char* name) {
  return fields.number_or(name, std::nan(""));
}

RecordingSummary recording_from_json(JsonFields fields) {
  RecordingSummary recording;
  recording.name = fields.text("name");
  recording.sha256 = fields.text("sha256");
  recording.samples = fields.count("samples");
  recording.sample_rate_hz = number_or_nan(fields, "sample_rate_hz");
  const auto test = test_kind_from(fields.text("test"));
  if (!test) fields.refuse("test", "unknown_value", "expected step, staircase, triangle, sweep or other");
  recording.test = test.value_or(TestKind::kOther);
  for (JsonFields& item : fields.objects("quality")) {
    recording.quality.push_back(
        {.code = item.text("code"), .detail = item.text("detail"), .count = item.count("count")});
  }
  return recording;
}

Baseline baseline_from_json(JsonFields fields) {
  Baseline baseline;
  const auto kind = baseline_kind_from(fields.text("kind"));
  if (!kind) fields.refuse("kind", "unknown_value", "expected reference, self or paper");
  baseline.kind = kind.value_or(BaselineKind::kSelf);
  baseline.reason = fields.text("reason");
  if (fields.has("reference")) {
    JsonFields reference = fields.object("reference");
    baseline.reference.emplace();
    baseline.reference->valve_type = reference.text("valve_type");
    baseline.reference->version = reference.small_count("version");
    baseline.reference->sha256 = reference.text("sha256");
    baseline.reference->valves = reference.small_count("valves");
    baseline.on_known_tests = reference.has("on_known_tests") && reference.flag("on_known_tests");
  }
  baseline.model = model_from_json(fields.object("model"));
  return baseline;
}

Simulation simulation_from_json(JsonFields fields) {
  Simulation simulation;
  simulation.rmse = number_or_nan(fields, "rmse");
  simulation.fit_percent = number_or_nan(fields, "fit_percent");
  simulation.noise_floor = number_or_nan(fields, "noise_floor");
  JsonFields window = fields.object("window");
  simulation.window = {.rate_hz = window.number("rate_hz"), .duration_s = window.number("duration_s")};
  for (JsonFields& level : fields.objects("by_level")) {
    simulation.by_level.push_back({.level_a = number_or_nan(level, "level_A"),
                                   .error_eq20 = level.optional_number("error_eq20"),
                                   .error_eq20_own = level.optional_number("error_eq20_own_fit"),
                                   .settling_error = level.optional_number("settling_error"),
                                   .rise_time_s = level.optional_number("rise_time_s"),
                                   .bandwidth_hz = level.optional_number("bandwidth_hz")});
  }
  for (JsonFields& recording : fields.objects("per_recording")) {
    simulation.per_recording.push_back({.name = recording.text("name"),
                                        .rmse = number_or_nan(recording, "rmse"),
                                        .fit_percent = number_or_nan(recording, "fit_percent"),
                                        .noise_floor = number_or_nan(recording, "noise_floor")});
  }
  simulation.cross_domain_rmse = fields.optional_number("cross_domain_rmse");
  return simulation;
}

LevelVerdict level_verdict_from_json(const std::string& name, JsonFields fields) {
  LevelVerdict level;
  level.level = name;
  level.verdict = fields.text("verdict");
  level.memberships = fields.number_by_name("memberships");
  for (JsonFields& rule : fields.objects("rules")) level.rules.emplace_back(rule.text("rule"), rule.number("strength"));
  return level;
}

ClassificationResult classification_from_json(JsonFields fields) {
  ClassificationResult result;
  result.verdict = fields.optional_text("verdict");
  if (fields.has("reason")) {
    result.reason = value_in(kNoVerdicts, fields.text("reason"));
    if (!result.reason) fields.refuse("reason", "unknown_value", "not one of the contract's reasons");
  }
  if (!result.verdict && !result.reason) fields.refuse("reason", "missing_field", "no verdict needs its reason");
  result.explanation = fields.text("explanation");
  result.action = fields.text("action");
  result.memberships = fields.number_by_name("memberships");
  for (auto& [name, level] : fields.objects_by_name("per_level")) {
    result.per_level.push_back(level_verdict_from_json(name, level));
  }
  if (fields.has("rule_base")) {
    JsonFields rule_base = fields.object("rule_base");
    result.rule_base_name = rule_base.text("name");
    result.rule_base_version = rule_base.text("version");
    result.rule_base_sha256 = rule_base.text("sha256");
  }
  result.without_stand_causes = fields.optional_text("without_stand_causes");
  return result;
}

using Names = std::vector<std::pair<std::string, std::string>>;

/// Recordings' names with their hashes, longest first: one name may be part of another.
Names names_in(const Json& recordings) {
  Names names;
  for (const Json& recording : recordings) {
    const std::string name = recording.value("name", "");
    if (!name.empty()) names.emplace_back(name, recording.value("sha256", ""));
  }
  std::stable_sort(names.begin(), names.end(),
                   [](const auto& a, const auto& b) { return a.first.size() > b.first.size(); });
  return names;
}

void replace_names(const Names& names, std::string& text) {
  for (const auto& [name, sha256] : names) {
    for (std::size_t at = text.find(name); at != std::string::npos; at = text.find(name, at + sha256.size())) {
      text.replace(at, name.size(), sha256);
    }
  }
}

/// What tells where something is speaks of a recording by its name; in a hash it speaks of its bytes.
void replace_names(Json& document) {
  if (!document["recordings"].is_array()) return;
  const Names names = names_in(document["recordings"]);
  if (Json& discrepancy = document["discrepancy"]; discrepancy.is_object() && discrepancy["findings"].is_array()) {
    for (Json& finding : discrepancy["findings"]) {
      if (finding["where"].is_string()) replace_names(names, finding["where"].get_ref<std::string&>());
    }
  }
  Json& model = document["extended_model"];
  if (!model.is_object() || !model.contains("mechanisms")) return;
  for (Json& mechanism : model["mechanisms"]) {
    if (!mechanism.is_object() || !mechanism.contains("channel") || !mechanism["channel"].is_string()) continue;
    auto& channel = mechanism["channel"].get_ref<std::string&>();
    for (const auto& [name, sha256] : names) {
      if (channel == name) {
        channel = sha256;
        break;
      }
    }
  }
}

}  // namespace

std::string to_string(BaselineKind kind) {
  return name_in(kBaselineKinds, kind);
}
std::optional<BaselineKind> baseline_kind_from(const std::string& name) {
  return value_in(kBaselineKinds, name);
}
std::string to_string(NoVerdict reason) {
  return name_in(kNoVerdicts, reason);
}

std::string result_sha256(Json document) {
  document.erase("timing_s");
  document.erase("result_sha256");
  replace_names(document);
  for (Json& recording : document["recordings"]) recording.erase("name");
  for (Json& recording : document["simulation"]["per_recording"]) recording.erase("name");
  // A store numbers its references, a file has none: the reference is what its sha256 says, wherever it is kept.
  if (Json& reference = document["baseline"]["reference"]; reference.is_object()) reference.erase("version");
  return canonical_sha256(document);
}

Json to_json(const Analysis& analysis, const AnalysisMaking& making) {
  Json document{{"schema", kAnalysisSchema},
                {"engine", {{"version", making.engine_version}, {"settings_sha256", making.settings_sha256}}},
                {"result_sha256", nullptr},
                {"recordings", list_to_json(analysis.recordings, to_json)},
                {"baseline", to_json(analysis.baseline)},
                {"simulation", to_json(analysis.simulation)},
                {"discrepancy", analysis.discrepancy ? to_json(*analysis.discrepancy) : Json(nullptr)},
                {"extended_model", to_json(analysis.extended_model)},
                {"frequency_response", frequency_response_json(analysis)},
                {"classification", to_json(analysis.classification)},
                {"timing_s", by_name(making.timing_s)}};
  document["result_sha256"] = result_sha256(document);
  return document;
}

Result<AnalysisDocument> analysis_from_json(const Json& document) {
  std::optional<Error> error;
  JsonFields fields(document, "", error);
  if (fields.ok() && fields.text_or("schema", "") != kAnalysisSchema) {
    return fail("not_an_analysis", fmt::format("this is no analysis: expected \"schema\": \"{}\"", kAnalysisSchema));
  }
  AnalysisDocument read;
  JsonFields engine = fields.object("engine");
  read.making.engine_version = engine.text("version");
  read.making.settings_sha256 = engine.text("settings_sha256");
  read.making.timing_s = fields.number_by_name("timing_s");
  read.result_sha256 = fields.text("result_sha256");
  for (JsonFields& recording : fields.objects("recordings")) {
    read.analysis.recordings.push_back(recording_from_json(recording));
  }
  if (read.analysis.recordings.empty()) fields.refuse("recordings", "out_of_range", "an analysis has recordings");
  read.analysis.baseline = baseline_from_json(fields.object("baseline"));
  read.analysis.simulation = simulation_from_json(fields.object("simulation"));
  if (fields.has("discrepancy")) read.analysis.discrepancy = discrepancy_from_json(fields.object("discrepancy"));
  read.analysis.extended_model = model_from_json(fields.object("extended_model"));
  read.analysis.classification = classification_from_json(fields.object("classification"));
  if (error) return tl::unexpected(*error);
  if (read.result_sha256 != result_sha256(document)) {
    return fail("result_changed", "result_sha256 does not fit the content: the analysis was changed after it was made");
  }
  return read;
}

}  // namespace valvetriage
