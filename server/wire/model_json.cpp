#include "server/wire/model_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/mechanisms/mechanism.h"

namespace valvetriage {
namespace {

using Roots = std::vector<std::complex<double>>;

Json roots_to_json(const Roots& roots) {
  Json list = Json::array();
  for (const auto& root : roots) list.push_back(Json::array({root.real(), root.imag()}));
  return list;
}

bool is_root(const Json& pair) {
  return pair.is_array() && pair.size() == 2 && pair[0].is_number() && pair[1].is_number();
}

/// Every complex root has its conjugate, to the rounding of a hand-written file.
bool closed_under_conjugation(const Roots& roots) {
  constexpr double kRelativeRounding = 1e-6;
  return std::all_of(roots.begin(), roots.end(), [&](const std::complex<double>& root) {
    const auto partner = [&](const std::complex<double>& other) {
      return std::abs(other - std::conj(root)) <= kRelativeRounding * std::abs(root);
    };
    return root.imag() == 0 || std::any_of(roots.begin(), roots.end(), partner);
  });
}

Roots roots_from_json(JsonFields& fields, const char* name) {
  const Json& list = fields.raw(name);
  if (!list.is_array() || list.size() > kMaxModelRoots || !std::all_of(list.begin(), list.end(), is_root)) {
    fields.refuse(name, "wrong_type", fmt::format("expected a list of at most {} pairs [re, im]", kMaxModelRoots));
    return {};
  }
  Roots roots;
  for (const Json& pair : list) roots.emplace_back(pair[0].get<double>(), pair[1].get<double>());
  if (!closed_under_conjugation(roots)) {
    fields.refuse(name, "out_of_range", "a complex root without its conjugate");
  }
  return roots;
}

void check_timing(JsonFields& fields, const TransferFunction& g) {
  if (g.delay_s < 0) fields.refuse("delay_s", "out_of_range", "a delay cannot be negative");
  if (g.domain == Domain::kS && g.sample_time_s != 0) {
    fields.refuse("sample_time_s", "out_of_range", "a transfer function in s has sample_time_s 0");
  }
  if (g.domain == Domain::kS) return;
  if (!(g.sample_time_s > 0)) {
    fields.refuse("sample_time_s", "out_of_range", "a transfer function in z needs a positive sample_time_s");
    return;
  }
  constexpr double kSampleRounding = 1e-3;  // files round their sample times
  const double samples = g.delay_s / g.sample_time_s;
  if (std::abs(samples - std::round(samples)) > kSampleRounding) {
    fields.refuse("delay_s", "out_of_range",
                  fmt::format("{} is no whole number of samples of {} s", g.delay_s, g.sample_time_s));
  }
}

StaticMap map_from_json(JsonFields fields) {
  StaticMap map{.input = fields.numbers("input"), .output = fields.numbers("output")};
  if (!fields.ok()) return map;
  if (map.input.size() < 2 || map.input.size() > kMaxMapKnots || map.input.size() != map.output.size()) {
    fields.refuse("", "out_of_range", fmt::format("a map has 2 to {} knots, as many outputs as inputs", kMaxMapKnots));
  } else if (std::adjacent_find(map.input.begin(), map.input.end(), std::greater_equal<>()) != map.input.end()) {
    fields.refuse("input", "out_of_range", "the knots must increase");
  } else if (!std::is_sorted(map.output.begin(), map.output.end()) &&
             !std::is_sorted(map.output.rbegin(), map.output.rend())) {
    fields.refuse("output", "out_of_range", "the map must only rise or only fall");
  }
  return map;
}

MagneticLoop loop_from_json(JsonFields fields) {
  MagneticLoop loop{.width_a = fields.number("width_A")};
  if (loop.width_a < 0) fields.refuse("width_A", "out_of_range", "a loop's width cannot be negative");
  if (fields.has("shares")) {
    const std::vector<double> shares = fields.numbers("shares");
    const double sum = std::accumulate(shares.begin(), shares.end(), 0.0);
    const bool any_negative = std::any_of(shares.begin(), shares.end(), [](double share) { return share < 0; });
    if (shares.size() != loop.shares.size() || any_negative || std::abs(sum - 1) > 1e-6) {
      fields.refuse("shares", "out_of_range", "a loop's shares are four numbers from 0 on whose sum is 1");
    } else {
      std::copy(shares.begin(), shares.end(), loop.shares.begin());
    }
  }
  if (fields.has("reach")) {
    loop.reach = fields.number("reach");
    if (fields.ok() && !(loop.reach > 0)) fields.refuse("reach", "out_of_range", "a loop's reach is positive");
  }
  return loop;
}

OrificeVolume volume_from_json(JsonFields fields) {
  OrificeVolume volume{.time_constant_s = fields.number("time_constant_s"),
                       .exponent = fields.number("exponent"),
                       .supply_psi = fields.number("supply_psi"),
                       .reference_psi = fields.number("reference_psi"),
                       .air_share = fields.has("air_share") ? fields.number("air_share") : 0};
  if (!fields.ok()) return volume;
  if (volume.air_share < 0) fields.refuse("air_share", "out_of_range", "a share of air cannot be negative");
  if (!(volume.time_constant_s > 0)) fields.refuse("time_constant_s", "out_of_range", "a time constant is positive");
  if (!(volume.exponent > 0)) fields.refuse("exponent", "out_of_range", "the flow exponent is positive");
  if (!(volume.reference_psi > 0 && volume.reference_psi < volume.supply_psi)) {
    fields.refuse("reference_psi", "out_of_range", "the reference pressure lies between 0 and the supply pressure");
  }
  return volume;
}

Mode mode_from_json(JsonFields fields) {
  const Mode mode{.natural_frequency_rad_s = fields.number("natural_frequency_rad_s"),
                  .damping_ratio = fields.number("damping_ratio")};
  if (!fields.ok()) return mode;
  if (!(mode.natural_frequency_rad_s > 0)) {
    fields.refuse("natural_frequency_rad_s", "out_of_range", "a mode's natural frequency is positive");
  }
  if (!(mode.damping_ratio > 0)) fields.refuse("damping_ratio", "out_of_range", "a mode's damping ratio is positive");
  return mode;
}

Json to_json(const Section& section) {
  if (section.order == 1) return Json{{"f", section.f}};
  return Json{{"e", section.e}, {"f", section.f}};
}

Json to_json(const MachineBlock& block) {
  Json parameters = Json::object();
  const auto names = parameter_names(block.law);
  for (std::size_t i = 0; i < names.size() && i < block.parameters.size(); ++i) {
    parameters[std::string(names[i])] = block.parameters[i];
  }
  Json document{{"law", name_of(block.law)}, {"parameters", parameters}};
  if (!block.numerator.empty()) {
    document["sections"] = list_to_json(block.sections, to_json);
    document["numerator"] = block.numerator;
  }
  if (!block.feedback.empty()) document["feedback"] = block.feedback;
  if (block.delay_samples != 0) document["delay_samples"] = block.delay_samples;
  if (!block.channel.empty()) document["channel"] = block.channel;
  return document;
}

Json to_json(const Machine& machine) {
  return Json{{"sample_time_s", machine.sample_period_s},
              {"input", machine.interval_means ? "interval_means" : "samples"},
              {"blocks", list_to_json(machine.blocks, to_json)}};
}

MachineBlock block_from_json(JsonFields& fields) {
  MachineBlock block;
  const auto law = machine_law_from(fields.text("law"));
  if (!law) fields.refuse("law", "unknown_value", "not one of the laws of a machine");
  block.law = law.value_or(MachineLaw::kAffine);
  JsonFields parameters = fields.object("parameters");
  for (const std::string_view name : parameter_names(block.law)) block.parameters.push_back(parameters.number(name));
  if (fields.has("sections")) {
    for (JsonFields& section : fields.objects("sections")) {
      const bool second = section.has("e");
      block.sections.push_back(
          {.order = second ? 2 : 1, .e = second ? section.number("e") : 0, .f = section.number("f")});
    }
  }
  if (fields.has("numerator")) block.numerator = fields.numbers("numerator");
  if (fields.has("feedback")) block.feedback = fields.numbers("feedback");
  if (fields.has("delay_samples")) block.delay_samples = fields.small_count("delay_samples");
  block.channel = fields.text_or("channel", "");
  return block;
}

Machine machine_from_json(JsonFields fields) {
  constexpr std::size_t kMostBlocks = 16;
  Machine machine{.sample_period_s = fields.number("sample_time_s"), .interval_means = false, .blocks = {}};
  const std::string input = fields.text_or("input", "samples");
  machine.interval_means = input == "interval_means";
  if (!machine.interval_means && input != "samples") {
    fields.refuse("input", "unknown_value", "expected \"samples\" or \"interval_means\"");
  }
  for (JsonFields& block : fields.objects("blocks")) machine.blocks.push_back(block_from_json(block));
  if (machine.blocks.size() > kMostBlocks) fields.refuse("blocks", "out_of_range", "there are more than 16 blocks");
  if (!fields.ok()) return machine;
  if (const auto checked = check_machine(machine); !checked) {
    fields.refuse("", "out_of_range", checked.error().message);
  }
  return machine;
}

/// Values by name in the order of the law; what a document may leave out has the law's own default.
std::vector<double> law_parameters(const Mechanism& law, JsonFields& fields) {
  const std::map<std::string, double> given = fields.number_by_name("parameters");
  std::vector<double> values;
  for (const MechanismParameter& parameter : law.parameters) {
    const auto found = given.find(std::string(parameter.name));
    values.push_back(found == given.end() ? parameter.otherwise : found->second);
    if (found == given.end() && std::isnan(parameter.otherwise)) {
      fields.refuse("parameters", "missing_field", fmt::format("{} needs {}", law.cause, parameter.name));
    }
  }
  for (const auto& [name, value] : given) {
    const auto is_it = [&](const MechanismParameter& parameter) { return parameter.name == name; };
    if (std::none_of(law.parameters.begin(), law.parameters.end(), is_it)) {
      fields.refuse("parameters", "unknown_value", fmt::format("{} has no parameter '{}'", law.cause, name));
    }
  }
  return values;
}

MechanismUse mechanism_from_json(JsonFields fields, const Model& model) {
  MechanismUse use{.cause = fields.text("cause"), .parameters = {}, .channel = fields.text_or("channel", "")};
  const Mechanism* law = find_mechanism(use.cause);
  if (law) {
    use.parameters = law_parameters(*law, fields);
    if (law->size_parameter < use.parameters.size()) {
      use.parameters[law->size_parameter] -= law->written_from(model.volume);
    }
  } else {
    fields.refuse("cause", "unknown_value", fmt::format("there is no cause '{}'", use.cause));
  }
  return use;
}

/// A value that is infinite stands for "there is none" and is left out.
Json to_json(const MechanismUse& use, const Model& model) {
  Json parameters = Json::object();
  const Mechanism* law = find_mechanism(use.cause);
  for (std::size_t j = 0; law && j < std::min(law->parameters.size(), use.parameters.size()); ++j) {
    const double from = j == law->size_parameter ? law->written_from(model.volume) : 0;
    if (std::isfinite(use.parameters[j])) parameters[std::string(law->parameters[j].name)] = from + use.parameters[j];
  }
  Json json{{"cause", use.cause}, {"parameters", parameters}};
  if (!use.channel.empty()) json["channel"] = use.channel;
  return json;
}

/// What an `identify` result says about a model: a linear system and the operating point it was fitted around.
Model from_identify_result(JsonFields fields) {
  Model model;
  model.kind = "linear";
  model.input_unit = fields.text_or("input_unit", "");
  model.output_unit = fields.text_or("output_unit", "");
  model.dynamics = transfer_function_from_json(fields.object("transfer_function"));
  model.input_offset = fields.number_or("input_offset", 0);
  model.output_offset = fields.number_or("output_offset", 0);
  return model;
}

}  // namespace

Json to_json(const TransferFunction& g) {
  return Json{{"domain", g.domain == Domain::kS ? "s" : "z"},
              {"sample_time_s", g.sample_time_s},
              {"zeros", roots_to_json(g.zeros)},
              {"poles", roots_to_json(g.poles)},
              {"gain", g.gain},
              {"delay_s", g.delay_s}};
}

TransferFunction transfer_function_from_json(JsonFields fields) {
  TransferFunction g;
  const std::string domain = fields.text("domain");
  if (domain != "s" && domain != "z") fields.refuse("domain", "unknown_value", "expected \"s\" or \"z\"");
  g.domain = domain == "s" ? Domain::kS : Domain::kZ;
  g.sample_time_s = fields.number_or("sample_time_s", 0);
  g.zeros = roots_from_json(fields, "zeros");
  g.poles = roots_from_json(fields, "poles");
  g.gain = fields.number("gain");
  g.delay_s = fields.number_or("delay_s", 0);
  if (g.zeros.size() > g.poles.size()) fields.refuse("zeros", "out_of_range", "there are more zeros than poles");
  check_timing(fields, g);
  return g;
}

Json to_json(const Model& model) {
  Json loop = nullptr, map = nullptr, volume = nullptr;
  if (model.loop) loop = Json{{"width_A", model.loop->width_a}, {"shares", model.loop->shares}};
  if (model.loop && model.loop->reach != 1) loop["reach"] = model.loop->reach;
  if (model.volume) {
    volume = Json{{"time_constant_s", model.volume->time_constant_s},
                  {"exponent", model.volume->exponent},
                  {"supply_psi", model.volume->supply_psi},
                  {"reference_psi", model.volume->reference_psi}};
    if (model.volume->air_share != 0) volume["air_share"] = model.volume->air_share;
  }
  if (model.map) map = Json{{"input", model.map->input}, {"output", model.map->output}};
  Json json{{"schema", "valvetriage.model/1"},
            {"kind", model.kind},
            {"input_unit", model.input_unit},
            {"output_unit", model.output_unit},
            {"loop", loop},
            {"transfer_function", to_json(model.dynamics)},
            {"map", map},
            {"volume", volume},
            {"input_offset", model.input_offset},
            {"output_offset", model.output_offset}};
  if (model.mode) {
    json["mode"] = Json{{"natural_frequency_rad_s", model.mode->natural_frequency_rad_s},
                        {"damping_ratio", model.mode->damping_ratio}};
  }
  if (model.input_between == InputBetween::kHeld) json["input_between"] = "held";
  if (model.machine) json["machine"] = to_json(*model.machine);
  if (!model.mechanisms.empty()) {
    Json& mechanisms = json["mechanisms"] = Json::array();
    for (const MechanismUse& use : model.mechanisms) mechanisms.push_back(to_json(use, model));
  }
  return json;
}

Model model_from_json(JsonFields fields) {
  Model model;
  model.kind = fields.text("kind");
  if (model.kind != "valve" && model.kind != "linear" && model.kind != "machine") {
    fields.refuse("kind", "unknown_value", "expected \"valve\", \"linear\" or \"machine\"");
  }
  model.input_unit = fields.text("input_unit");
  model.output_unit = fields.text("output_unit");
  if (fields.has("map")) model.map = map_from_json(fields.object("map"));
  if (fields.has("loop")) model.loop = loop_from_json(fields.object("loop"));
  if (fields.has("volume")) model.volume = volume_from_json(fields.object("volume"));
  if (model.kind == "valve" && !model.map) fields.refuse("map", "missing_field", "a valve's model needs its map");
  model.dynamics = transfer_function_from_json(fields.object("transfer_function"));
  model.input_offset = fields.number_or("input_offset", 0);
  model.output_offset = fields.number_or("output_offset", 0);
  if (fields.has("mode")) {
    model.mode = mode_from_json(fields.object("mode"));
    if (!model.map || !to_valve_dynamics(model.dynamics)) {
      fields.refuse("mode", "out_of_range",
                    "a mode stands behind the map of a valve whose transfer function is a spool");
    }
  }
  const std::string between = fields.text_or("input_between", "straight");
  model.input_between = between == "held" ? InputBetween::kHeld : InputBetween::kStraight;
  if (between != "held" && between != "straight") {
    fields.refuse("input_between", "unknown_value", "expected \"straight\" or \"held\"");
  }
  if (fields.has("machine")) model.machine = machine_from_json(fields.object("machine"));
  if (model.kind == "machine" && !model.machine) {
    fields.refuse("machine", "missing_field", "a machine needs its blocks");
  }
  if (!fields.has("mechanisms")) return model;
  for (JsonFields& use : fields.objects("mechanisms")) model.mechanisms.push_back(mechanism_from_json(use, model));
  if (model.mechanisms.size() > kMaxModelMechanisms) {
    fields.refuse("mechanisms", "out_of_range", fmt::format("at most {} mechanisms", kMaxModelMechanisms));
  }
  return model;
}

Result<Model> model_from_json(const Json& document) {
  std::optional<Error> error;
  JsonFields fields(document, "", error);
  if (fields.has("baseline") && fields.has("recordings")) {
    return fail("not_a_model", "this is a whole analysis: give what stands at its extended_model or baseline.model");
  }
  const bool is_model = fields.has("kind");
  if (!is_model && !fields.has("transfer_function")) {
    return fail("not_a_model", "this is neither a model (kind, transfer_function) nor an identify result");
  }
  Model model = is_model ? model_from_json(fields) : from_identify_result(fields);
  if (error) return tl::unexpected(*error);
  return model;
}

}  // namespace valvetriage
