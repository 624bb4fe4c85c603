#include "server/wire/rule_base_json.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/classify/check.h"
#include "server/wire/canonical_json.h"
#include "server/wire/embedded_rule_bases.h"
#include "server/wire/json_fields.h"

namespace valvetriage {
namespace {

constexpr std::string_view kRuleBaseSchema = "valvetriage.rule_base/1";
/// Bounds on what a rule base may cost: the check evaluates every rule on a grid.
constexpr std::size_t kMaxLevels = 16;
constexpr std::size_t kMaxSets = 16;
constexpr std::size_t kMaxRules = 512;

std::optional<Verdict> exact_verdict(const std::string& name) {
  const auto verdict = verdict_from(name);
  return verdict && to_string(*verdict) == name ? verdict : std::nullopt;
}

/// A word that `read` knows; otherwise the error says which words there are.
template <typename Read>
auto word(JsonFields& fields, std::string_view name, Read read, std::string_view known) {
  const std::string found = fields.text(name);
  const auto value = read(found);
  if (!value && fields.ok()) fields.refuse(name, "unknown_value", fmt::format("is '{}', expected {}", found, known));
  return value.value_or(typename std::decay_t<decltype(value)>::value_type{});
}

Verdict read_verdict(JsonFields& fields, std::string_view name) {
  return word(fields, name, exact_verdict, "Good, Malfunctioned or Severe");
}

/// A list of at most `most` objects.
std::vector<JsonFields> bounded_objects(JsonFields& fields, std::string_view name, std::size_t most) {
  auto objects = fields.objects(name);
  if (objects.size() > most) {
    fields.refuse(name, "out_of_range", fmt::format("has {} entries, at most {} are accepted", objects.size(), most));
    objects.clear();
  }
  return objects;
}

Trapezoid read_points(JsonFields& fields) {
  const Json& points = fields.raw("points");
  const auto is_corner = [](const Json& point) { return point.is_null() || point.is_number(); };
  if (!points.is_array() || points.size() != 4 || !std::all_of(points.begin(), points.end(), is_corner)) {
    fields.refuse("points", "wrong_type", "must be four numbers a, b, c, d; null is an open shoulder");
    return {};
  }
  const auto corner = [&](std::size_t i) {
    const double open = i < 2 ? -kOpen : kOpen;
    return points[i].is_null() ? open : points[i].get<double>();
  };
  return {corner(0), corner(1), corner(2), corner(3)};
}

FuzzyInput read_input(JsonFields& fields) {
  FuzzyInput input;
  input.quantity = word(fields, "quantity", quantity_from, "error, settling_error, rise_time_s or bandwidth_time_s");
  for (JsonFields& set : bounded_objects(fields, "sets", kMaxSets)) {
    input.sets.push_back({set.text("name"), read_points(set)});
  }
  return input;
}

std::optional<std::size_t> set_index(const FuzzyInput& input, const Json& name) {
  for (std::size_t s = 0; s < input.sets.size(); ++s) {
    if (name == input.sets[s].name) return s;
  }
  return std::nullopt;
}

Rule read_rule(JsonFields& fields, const std::vector<FuzzyInput>& inputs) {
  Rule rule{.then = read_verdict(fields, "then")};
  const Json& conditions = fields.raw("if");
  if (!conditions.is_array() || conditions.size() != inputs.size()) {
    fields.refuse("if", "wrong_type",
                  fmt::format("must name one set (or null) for each of the {} inputs", inputs.size()));
    return rule;
  }
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    rule.sets.push_back(set_index(inputs[i], conditions[i]));
    if (!rule.sets.back() && !conditions[i].is_null()) {
      fields.refuse("if", "unknown_value",
                    fmt::format("{} is not a set of {}", dump_json(conditions[i]), to_string(inputs[i].quantity)));
    }
  }
  return rule;
}

CrispRanges read_crisp(JsonFields fields) {
  const auto of = [](std::string_view name) -> std::optional<CrispRanges::Of> {
    if (name == "centroid") return CrispRanges::Of::kCentroid;
    if (name == "error") return CrispRanges::Of::kError;
    return std::nullopt;
  };
  return {word(fields, "of", of, "centroid or error"), fields.number("malfunctioned_from"),
          fields.number("severe_from")};
}

LevelRules read_level(JsonFields& fields) {
  LevelRules level{.name = fields.text("name"), .level_a = fields.number("level_A")};
  for (JsonFields& input : bounded_objects(fields, "inputs", kQuantities.size()))
    level.inputs.push_back(read_input(input));
  for (JsonFields& set : bounded_objects(fields, "output", kVerdictCount)) {
    level.output.push_back({read_verdict(set, "verdict"), read_points(set)});
  }
  for (JsonFields& rule : bounded_objects(fields, "rules", kMaxRules))
    level.rules.push_back(read_rule(rule, level.inputs));
  level.crisp = read_crisp(fields.object("crisp"));
  return level;
}

/// `minimum` or `product`, for conjunction and implication alike.
template <typename Operator>
Operator read_operator(JsonFields& fields, std::string_view name) {
  const auto read = [](std::string_view found) -> std::optional<Operator> {
    if (found == "minimum") return Operator::kMinimum;
    if (found == "product") return Operator::kProduct;
    return std::nullopt;
  };
  return word(fields, name, read, "minimum or product");
}

RuleBase read_rule_base(JsonFields& fields) {
  if (fields.text("schema") != kRuleBaseSchema && fields.ok()) {
    fields.refuse("schema", "unknown_value", fmt::format("must be '{}'", kRuleBaseSchema));
  }
  RuleBase base{.name = fields.text("name"), .version = fields.text("version")};
  base.description = fields.text_or("description", "");
  if (fields.has("rate_hz") || fields.has("duration_s") || fields.has("unit")) {
    base.window = FeatureWindow{fields.number("rate_hz"), fields.number("duration_s"), fields.text("unit")};
  }
  base.conjunction = read_operator<Conjunction>(fields, "conjunction");
  base.implication = read_operator<Implication>(fields, "implication");
  if (fields.has("aggregation")) {
    const auto read = [](std::string_view found) -> std::optional<Aggregation> {
      if (found == "maximum") return Aggregation::kMaximum;
      if (found == "sum") return Aggregation::kSum;
      return std::nullopt;
    };
    base.aggregation = word(fields, "aggregation", read, "maximum or sum");
  }
  for (JsonFields& level : bounded_objects(fields, "levels", kMaxLevels)) base.levels.push_back(read_level(level));
  return base;
}

Json points_json(const Trapezoid& shape) {
  Json points = Json::array();
  for (const double corner : {shape.a, shape.b, shape.c, shape.d}) {
    points.push_back(finite_or_null(corner));
  }
  return points;
}

Json input_json(const FuzzyInput& input) {
  Json sets = Json::array();
  for (const InputSet& set : input.sets) sets.push_back({{"name", set.name}, {"points", points_json(set.shape)}});
  return {{"quantity", to_string(input.quantity)}, {"sets", sets}};
}

Json rule_json(const LevelRules& level, const Rule& rule) {
  Json conditions = Json::array();
  for (std::size_t i = 0; i < rule.sets.size(); ++i) {
    conditions.push_back(rule.sets[i] ? Json(level.inputs[i].sets[*rule.sets[i]].name) : Json(nullptr));
  }
  return {{"if", conditions}, {"then", to_string(rule.then)}};
}

Json level_json(const LevelRules& level) {
  Json inputs = Json::array();
  Json output = Json::array();
  Json rules = Json::array();
  for (const FuzzyInput& input : level.inputs) inputs.push_back(input_json(input));
  for (const OutputSet& set : level.output) {
    output.push_back({{"verdict", to_string(set.verdict)}, {"points", points_json(set.shape)}});
  }
  for (const Rule& rule : level.rules) rules.push_back(rule_json(level, rule));
  const bool of_error = level.crisp.of == CrispRanges::Of::kError;
  return {{"name", level.name},
          {"level_A", level.level_a},
          {"inputs", inputs},
          {"output", output},
          {"rules", rules},
          {"crisp",
           {{"of", of_error ? "error" : "centroid"},
            {"malfunctioned_from", level.crisp.malfunctioned_from},
            {"severe_from", level.crisp.severe_from}}}};
}

Json level_json(const LevelClassification& level) {
  Json rules = Json::array();
  for (const FiredRule& rule : level.rules) rules.push_back({{"rule", rule.text}, {"strength", rule.strength}});
  Json json{{"verdict", to_string(level.verdict)}, {"memberships", to_json(level.memberships)}, {"rules", rules}};
  for (const Quantity missing : level.inputs_missing) json["inputs_missing"].push_back(to_string(missing));
  return json;
}

}  // namespace

Result<RuleBase> rule_base_from_json(std::string_view text) {
  if (text.size() > kMaxRuleBaseBytes) {
    return fail("too_large",
                fmt::format("a rule base of {} bytes: at most {} are accepted", text.size(), kMaxRuleBaseBytes));
  }
  const auto document = parse_json(text);
  if (!document) return tl::unexpected(document.error());
  std::optional<Error> error;
  JsonFields fields(*document, "", error);
  RuleBase base = read_rule_base(fields);
  if (error) return tl::unexpected(*error);
  if (auto valid = validate(base); !valid) return tl::unexpected(valid.error());
  if (auto sound = require_sound(base); !sound) return tl::unexpected(sound.error());
  base.sha256 = rule_base_sha256(base);
  return base;
}

Json to_json(const RuleBase& base) {
  Json json{{"schema", kRuleBaseSchema}, {"name", base.name}, {"version", base.version}};
  if (!base.description.empty()) json["description"] = base.description;
  if (base.window) {
    json["rate_hz"] = base.window->rate_hz;
    json["duration_s"] = base.window->duration_s;
    json["unit"] = base.window->unit;
  }
  json["conjunction"] = base.conjunction == Conjunction::kMinimum ? "minimum" : "product";
  json["implication"] = base.implication == Implication::kMinimum ? "minimum" : "product";
  if (base.aggregation == Aggregation::kSum) json["aggregation"] = "sum";  // maximum where it is not said
  json["levels"] = Json::array();
  for (const LevelRules& level : base.levels) json["levels"].push_back(level_json(level));
  return json;
}

std::string rule_base_sha256(const RuleBase& base) {
  return canonical_sha256(to_json(base));
}

Result<RuleBase> embedded_rule_base(std::string_view name) {
  for (const auto& [embedded_name, text] : kEmbeddedRuleBases) {
    if (name == embedded_name) return rule_base_from_json(text);
  }
  return fail("unknown_rule_base",
              fmt::format("'{}' is neither a file nor one of the rule bases paper, calibrated", name));
}

Json to_json(const Memberships& memberships) {
  Json json = Json::object();
  for (const Verdict verdict : kVerdicts) json[std::string(membership_key(verdict))] = memberships[index_of(verdict)];
  return json;
}

Json to_json(const Classification& classification) {
  Json json{{"verdict", classification.verdict ? Json(to_string(*classification.verdict)) : Json(nullptr)}};
  if (classification.reason) json["reason"] = "level_missing";
  json["memberships"] = to_json(classification.memberships);
  json["per_level"] = Json::object();
  for (const LevelClassification& level : classification.per_level) json["per_level"][level.level] = level_json(level);
  return json;
}

Json rule_base_identity(const RuleBase& base) {
  return {{"name", base.name}, {"version", base.version}, {"sha256", base.sha256}};
}

}  // namespace valvetriage
