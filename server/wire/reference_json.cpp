#include "server/wire/reference_json.h"

#include <fmt/format.h>

#include "server/wire/canonical_json.h"
#include "server/wire/model_json.h"

namespace valvetriage {
namespace {

Json to_json(const ReferenceMember& member) {
  return Json{{"serial", member.serial},
              {"recordings", member.recordings},
              {"rmse", member.rmse},
              {"distance", member.distance},
              {"used", member.used}};
}

Json to_json(const PopulationParameter& parameter) {
  return Json{{"name", parameter.name},
              {"unit", parameter.unit},
              {"transform", parameter.transform},
              {"mean", parameter.mean},
              {"sd", parameter.sd}};
}

Json to_json(const LevelPopulation& level) {
  return Json{{"level_A", level.level_a},
              {"error_eq20_mean", level.error_eq20_mean},
              {"error_eq20_sd", level.error_eq20_sd},
              {"settling_error_mean", level.settling_error_mean},
              {"settling_error_sd", level.settling_error_sd},
              {"rise_time_mean_s", level.rise_time_mean_s},
              {"rise_time_sd_s", level.rise_time_sd_s}};
}

Json to_json(const CauseOnGoodValves& cause) {
  Json json{{"cause", cause.cause},
            {"evidence_mean", cause.evidence_mean},
            {"evidence_sd", cause.evidence_sd},
            {"size_mean", cause.size_mean},
            {"size_sd", cause.size_sd}};
  if (cause.size_valves) json["size_valves"] = *cause.size_valves;
  return json;
}

Json to_json(const LeftoverOnGoodValves& leftover) {
  Json json{{"group", leftover.group}, {"mean", leftover.mean}, {"sd", leftover.sd}};
  if (leftover.valves) json["valves"] = *leftover.valves;
  return json;
}

Json to_json(const KnownTest& test) {
  return Json{{"sample_period_s", test.sample_period_s}, {"input_A", test.input}, {"residual_psi", test.residual}};
}

Json content(const Reference& reference);

Json to_json(const OnKnownTests& known) {
  return Json{{"tests", list_to_json(known.tests, to_json)}, {"reference", content(known.reference)}};
}

/// Everything that makes the reference what it is.
Json content(const Reference& reference) {
  Json document{{"schema", "valvetriage.reference/1"},
                {"valve_type", reference.valve_type},
                {"valves", reference.valves},
                {"members", list_to_json(reference.members, to_json)},
                {"sample_period_s", reference.sample_period_s},
                {"model", to_json(reference.model)},
                {"map_sd", reference.map_sd},
                {"parameters", list_to_json(reference.parameters, to_json)},
                {"covariance", reference.covariance},
                {"prior_degrees_of_freedom", reference.prior_degrees_of_freedom},
                {"noise_floor", reference.noise_floor},
                {"input_min_A", reference.input_min},
                {"input_max_A", reference.input_max},
                {"bandwidth_hz", reference.bandwidth_hz},
                {"tests", reference.tests},
                {"window", {{"rate_hz", reference.window.rate_hz}, {"duration_s", reference.window.duration_s}}},
                {"levels", list_to_json(reference.levels, to_json)}};
  if (!reference.causes.empty()) document["causes"] = list_to_json(reference.causes, to_json);
  if (!reference.leftovers.empty()) document["leftovers"] = list_to_json(reference.leftovers, to_json);
  for (const OnKnownTests& known : reference.on_known_tests) document["on_known_tests"] = to_json(known);
  return document;
}

ReferenceMember member_from_json(JsonFields fields) {
  return {.serial = fields.text("serial"),
          .recordings = fields.small_count("recordings"),
          .rmse = fields.number("rmse"),
          .distance = fields.number("distance"),
          .used = fields.flag("used")};
}

PopulationParameter parameter_from_json(JsonFields fields) {
  PopulationParameter parameter{.name = fields.text("name"),
                                .unit = fields.text("unit"),
                                .transform = fields.text("transform"),
                                .mean = fields.number("mean"),
                                .sd = fields.number("sd")};
  if (parameter.transform != "linear" && parameter.transform != "log") {
    fields.refuse("transform", "unknown_value", "expected \"linear\" or \"log\"");
  }
  if (parameter.sd < 0) fields.refuse("sd", "out_of_range", "a standard deviation cannot be negative");
  return parameter;
}

LevelPopulation level_from_json(JsonFields fields) {
  return {.level_a = fields.number("level_A"),
          .error_eq20_mean = fields.number("error_eq20_mean"),
          .error_eq20_sd = fields.number("error_eq20_sd"),
          .settling_error_mean = fields.number("settling_error_mean"),
          .settling_error_sd = fields.number("settling_error_sd"),
          .rise_time_mean_s = fields.number("rise_time_mean_s"),
          .rise_time_sd_s = fields.number("rise_time_sd_s")};
}

CauseOnGoodValves cause_from_json(JsonFields fields) {
  CauseOnGoodValves cause{.cause = fields.text("cause"),
                          .evidence_mean = fields.number("evidence_mean"),
                          .evidence_sd = fields.number_or("evidence_sd", 0),
                          .size_mean = fields.number("size_mean"),
                          .size_sd = fields.number("size_sd")};
  if (fields.has("size_valves")) cause.size_valves = fields.small_count("size_valves");
  return cause;
}

LeftoverOnGoodValves leftover_from_json(JsonFields fields) {
  LeftoverOnGoodValves leftover{
      .group = fields.text("group"), .mean = fields.number("mean"), .sd = fields.number("sd")};
  if (fields.has("valves")) leftover.valves = fields.small_count("valves");
  return leftover;
}

void check_sizes(JsonFields& fields, const Reference& reference) {
  if (!fields.ok()) return;
  const std::size_t knots = reference.model.map ? reference.model.map->input.size() : 0;
  const std::size_t p = reference.parameters.size() + knots;
  if (reference.map_sd.size() != knots) {
    fields.refuse("map_sd", "out_of_range", fmt::format("expected one number for each of the {} knots", knots));
  } else if (reference.covariance.size() != p * p) {
    fields.refuse("covariance", "out_of_range",
                  fmt::format("expected {} numbers ({} parameters and {} knots, squared), found {}", p * p,
                              reference.parameters.size(), knots, reference.covariance.size()));
  }
}

KnownTest test_from_json(JsonFields fields) {
  KnownTest test{.sample_period_s = fields.number("sample_period_s"),
                 .input = fields.numbers("input_A"),
                 .residual = fields.numbers("residual_psi")};
  if (!fields.ok()) return test;
  if (!(test.sample_period_s > 0)) fields.refuse("sample_period_s", "out_of_range", "expected more than 0");
  if (test.input.empty() || test.input.size() != test.residual.size()) {
    fields.refuse("residual_psi", "out_of_range",
                  fmt::format("expected one number for each of the {} samples of the input", test.input.size()));
  }
  return test;
}

Reference reference_from(JsonFields& fields) {
  Reference reference;
  reference.valve_type = fields.text("valve_type");
  reference.version = fields.has("version") ? fields.small_count("version") : 0;
  reference.valves = fields.small_count("valves");
  for (JsonFields& member : fields.objects("members")) reference.members.push_back(member_from_json(member));
  reference.sample_period_s = fields.number("sample_period_s");
  reference.model = model_from_json(fields.object("model"));
  reference.map_sd = fields.numbers("map_sd");
  for (JsonFields& item : fields.objects("parameters")) reference.parameters.push_back(parameter_from_json(item));
  reference.covariance = fields.numbers("covariance");
  reference.prior_degrees_of_freedom = fields.number("prior_degrees_of_freedom");
  reference.noise_floor = fields.number("noise_floor");
  reference.input_min = fields.number("input_min_A");
  reference.input_max = fields.number("input_max_A");
  reference.bandwidth_hz = fields.number("bandwidth_hz");
  reference.tests = fields.texts("tests");
  JsonFields window = fields.object("window");
  reference.window = {.rate_hz = window.number("rate_hz"), .duration_s = window.number("duration_s")};
  for (JsonFields& level : fields.objects("levels")) reference.levels.push_back(level_from_json(level));
  if (fields.has("causes")) {
    for (JsonFields& cause : fields.objects("causes")) reference.causes.push_back(cause_from_json(cause));
  }
  if (fields.has("leftovers")) {
    for (JsonFields& leftover : fields.objects("leftovers")) {
      reference.leftovers.push_back(leftover_from_json(leftover));
    }
  }
  if (reference.members.size() > kMaxReferenceMembers || reference.levels.size() > kMaxReferenceLevels) {
    fields.refuse("", "too_large", "too many members or levels");
  }
  check_sizes(fields, reference);
  return reference;
}

}  // namespace

std::string reference_sha256(const Reference& reference) {
  return canonical_sha256(content(reference));
}

Json to_json(const Reference& reference) {
  const Json body = content(reference);
  Json document = Json::object();
  for (const auto& [key, value] : body.items()) {
    document[key] = value;
    if (key == "valve_type") {
      document["version"] = reference.version;
      document["sha256"] = canonical_sha256(body);
    }
  }
  return document;
}

Result<Reference> reference_from_json(const Json& document) {
  std::optional<Error> error;
  JsonFields fields(document, "", error);
  if (fields.ok() && fields.text_or("schema", "") != "valvetriage.reference/1") {
    return fail("not_a_reference", "this is no reference: expected \"schema\": \"valvetriage.reference/1\"");
  }
  Reference reference = reference_from(fields);
  if (fields.has("on_known_tests")) {
    JsonFields known = fields.object("on_known_tests");
    JsonFields beyond = known.object("reference");
    OnKnownTests& on_known = reference.on_known_tests.emplace_back();
    for (JsonFields& test : known.objects("tests")) on_known.tests.push_back(test_from_json(test));
    on_known.reference = reference_from(beyond);
    if (on_known.tests.size() > kMaxKnownTests) known.refuse("tests", "too_large", "too many tests");
    if (on_known.tests.empty()) known.refuse("tests", "out_of_range", "expected one test at least");
  }
  if (error) return tl::unexpected(*error);
  reference.sha256 = reference_sha256(reference);
  return reference;
}

}  // namespace valvetriage
