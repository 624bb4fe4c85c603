#include "server/wire/discrepancy_json.h"

#include <array>
#include <limits>
#include <utility>

namespace valvetriage {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

constexpr std::array<std::pair<Conclusion, const char*>, 4> kConclusions{{{Conclusion::kNone, "none"},
                                                                          {Conclusion::kNamed, "named"},
                                                                          {Conclusion::kAmbiguous, "ambiguous"},
                                                                          {Conclusion::kUnexplained, "unexplained"}}};

constexpr std::array<std::pair<CandidateStatus, const char*>, 3> kStatuses{
    {{CandidateStatus::kTested, "tested"},
     {CandidateStatus::kNotExcited, "not_excited"},
     {CandidateStatus::kNotIdentifiable, "not_identifiable"}}};

template <typename Value, std::size_t n>
std::string name_in(const std::array<std::pair<Value, const char*>, n>& table, Value value) {
  for (const auto& [entry, name] : table) {
    if (entry == value) return name;
  }
  return {};
}

template <typename Value, std::size_t n>
Value value_in(const std::array<std::pair<Value, const char*>, n>& table, JsonFields& fields, const char* name) {
  const std::string wanted = fields.text(name);
  for (const auto& [entry, text] : table) {
    if (wanted == text) return entry;
  }
  fields.refuse(name, "unknown_value", "not one of the contract's words");
  return table.front().first;
}

Json interval(const std::array<double, 2>& ends) {
  return Json::array({finite_or_null(ends[0]), finite_or_null(ends[1])});
}

std::array<double, 2> interval_from_json(JsonFields& fields, const char* name) {
  const Json& list = fields.raw(name);
  if (!list.is_array() || list.size() != 2) {
    fields.refuse(name, "wrong_type", "expected two numbers");
    return {kUnknown, kUnknown};
  }
  const auto end = [&](std::size_t i) { return list[i].is_number() ? list[i].get<double>() : kUnknown; };
  return {end(0), end(1)};
}

Json by_name(const std::map<std::string, double>& values) {
  Json object = Json::object();
  for (const auto& [name, value] : values) object[name] = finite_or_null(value);
  return object;
}

std::map<std::string, double> by_name_from_json(JsonFields& fields, const char* name) {
  std::map<std::string, double> values;
  const Json& object = fields.raw(name);
  if (!object.is_object()) {
    fields.refuse(name, "wrong_type", "expected an object of numbers");
    return values;
  }
  for (const auto& [key, value] : object.items()) values[key] = value.is_number() ? value.get<double>() : kUnknown;
  return values;
}

Json to_json(const Finding& finding) {
  return Json{{"what", finding.what},
              {"where", finding.where},
              {"statistic", finite_or_null(finding.statistic)},
              {"p_value", finite_or_null(finding.p_value)},
              {"share_of_structured_residual", finite_or_null(finding.share_of_structured_residual)}};
}

Json to_json(const ParameterEstimate& parameter) {
  return Json{{"value", parameter.text.empty() ? finite_or_null(parameter.value) : Json(parameter.text)},
              {"std_error", finite_or_null(parameter.std_error)},
              {"ci95", interval(parameter.ci95)},
              {"unit", parameter.unit},
              {"population_mean", finite_or_null(parameter.population_mean)},
              {"population_sd", finite_or_null(parameter.population_sd)}};
}

Json to_json(const NamedCause& cause) {
  Json parameters = Json::object();
  for (const auto& [name, parameter] : cause.parameters) parameters[name] = to_json(parameter);
  return Json{{"cause", cause.cause},
              {"family", cause.family},
              {"origin", cause.origin},
              {"probability", finite_or_null(cause.probability)},
              {"family_probability", finite_or_null(cause.family_probability)},
              {"alternatives", cause.alternatives},
              {"parameters", parameters},
              {"severity",
               {{"in_population_sd", finite_or_null(cause.severity_in_population_sd)},
                {"error_eq20_caused", by_name(cause.error_eq20_caused)}}},
              {"gain",
               {{"rmse_before", finite_or_null(cause.rmse_before)},
                {"rmse_after", finite_or_null(cause.rmse_after)},
                {"p_value", finite_or_null(cause.p_value)}}},
              {"evidence", cause.evidence}};
}

Json to_json(const Candidate& candidate) {
  return Json{{"cause", candidate.cause},
              {"probability", finite_or_null(candidate.probability)},
              {"rmse_heldout", finite_or_null(candidate.rmse_heldout)},
              {"status", to_string(candidate.status)},
              {"reason", candidate.reason},
              {"upper_limit95", by_name(candidate.upper_limit95)}};
}

Json to_json(const Transfer& transfer) {
  return Json{{"from", transfer.from},
              {"to", transfer.to},
              {"rmse_baseline", finite_or_null(transfer.rmse_baseline)},
              {"rmse_extended", finite_or_null(transfer.rmse_extended)}};
}

Json to_json(const DiscrepancyGain& gain) {
  return Json{{"heldout", gain.heldout},
              {"rmse_baseline", finite_or_null(gain.rmse_baseline)},
              {"rmse_extended", finite_or_null(gain.rmse_extended)},
              {"rmse_black_box", finite_or_null(gain.rmse_black_box)},
              {"noise_floor", finite_or_null(gain.noise_floor)},
              {"reduction", finite_or_null(gain.reduction)},
              {"reduction_ci95", interval(gain.reduction_ci95)},
              {"transfer", list_to_json(gain.transfer, to_json)}};
}

Json to_json(const NextTest& test) {
  return Json{{"test", test.test},
              {"why", test.why},
              {"separates", test.separates},
              {"expected_probability", finite_or_null(test.expected_probability)},
              {"input_csv", test.input_csv}};
}

Finding finding_from_json(JsonFields& fields) {
  return {.what = fields.text("what"),
          .where = fields.text("where"),
          .statistic = fields.number_or("statistic", kUnknown),
          .p_value = fields.number_or("p_value", kUnknown),
          .share_of_structured_residual = fields.number_or("share_of_structured_residual", kUnknown)};
}

ParameterEstimate parameter_from_json(JsonFields& fields) {
  ParameterEstimate parameter;
  if (fields.raw("value").is_string()) {
    parameter.text = fields.text("value");
  } else {
    parameter.value = fields.number_or("value", kUnknown);
  }
  parameter.std_error = fields.number_or("std_error", kUnknown);
  parameter.ci95 = interval_from_json(fields, "ci95");
  parameter.unit = fields.text("unit");
  parameter.population_mean = fields.number_or("population_mean", kUnknown);
  parameter.population_sd = fields.number_or("population_sd", kUnknown);
  return parameter;
}

NamedCause cause_from_json(JsonFields& fields) {
  NamedCause cause;
  cause.cause = fields.text("cause");
  cause.family = fields.text("family");
  cause.origin = fields.text("origin");
  cause.probability = fields.number_or("probability", kUnknown);
  cause.family_probability = fields.number_or("family_probability", kUnknown);
  cause.alternatives = fields.texts("alternatives");
  for (auto& [name, parameter] : fields.objects_by_name("parameters")) {
    cause.parameters.emplace_back(name, parameter_from_json(parameter));
  }
  JsonFields severity = fields.object("severity");
  cause.severity_in_population_sd = severity.number_or("in_population_sd", kUnknown);
  cause.error_eq20_caused = by_name_from_json(severity, "error_eq20_caused");
  JsonFields gain = fields.object("gain");
  cause.rmse_before = gain.number_or("rmse_before", kUnknown);
  cause.rmse_after = gain.number_or("rmse_after", kUnknown);
  cause.p_value = gain.number_or("p_value", kUnknown);
  cause.evidence = fields.texts("evidence");
  return cause;
}

Candidate candidate_from_json(JsonFields& fields) {
  Candidate candidate;
  candidate.cause = fields.text("cause");
  candidate.probability = fields.number_or("probability", kUnknown);
  candidate.rmse_heldout = fields.number_or("rmse_heldout", kUnknown);
  candidate.status = value_in(kStatuses, fields, "status");
  candidate.reason = fields.text("reason");
  candidate.upper_limit95 = by_name_from_json(fields, "upper_limit95");
  return candidate;
}

DiscrepancyGain gain_from_json(JsonFields fields) {
  DiscrepancyGain gain;
  gain.heldout = fields.text("heldout");
  gain.rmse_baseline = fields.number_or("rmse_baseline", kUnknown);
  gain.rmse_extended = fields.number_or("rmse_extended", kUnknown);
  gain.rmse_black_box = fields.number_or("rmse_black_box", kUnknown);
  gain.noise_floor = fields.number_or("noise_floor", kUnknown);
  gain.reduction = fields.number_or("reduction", kUnknown);
  gain.reduction_ci95 = interval_from_json(fields, "reduction_ci95");
  for (JsonFields& transfer : fields.objects("transfer")) {
    gain.transfer.push_back({.from = transfer.text("from"),
                             .to = transfer.text("to"),
                             .rmse_baseline = transfer.number_or("rmse_baseline", kUnknown),
                             .rmse_extended = transfer.number_or("rmse_extended", kUnknown)});
  }
  return gain;
}

NextTest next_test_from_json(JsonFields fields) {
  NextTest test;
  test.test = fields.text("test");
  test.why = fields.text("why");
  test.separates = fields.texts("separates");
  test.expected_probability = fields.number_or("expected_probability", kUnknown);
  test.input_csv = fields.text("input_csv");
  return test;
}

}  // namespace

std::string to_string(Conclusion conclusion) {
  return name_in(kConclusions, conclusion);
}
std::string to_string(CandidateStatus status) {
  return name_in(kStatuses, status);
}

Json to_json(const Discrepancy& discrepancy) {
  return Json{{"conclusion", to_string(discrepancy.conclusion)},
              {"findings", list_to_json(discrepancy.findings, to_json)},
              {"causes", list_to_json(discrepancy.causes, to_json)},
              {"candidates", list_to_json(discrepancy.candidates, to_json)},
              {"gain", to_json(discrepancy.gain)},
              {"next_test", discrepancy.next_test ? to_json(*discrepancy.next_test) : Json(nullptr)}};
}

Discrepancy discrepancy_from_json(JsonFields fields) {
  Discrepancy discrepancy;
  discrepancy.conclusion = value_in(kConclusions, fields, "conclusion");
  for (JsonFields& finding : fields.objects("findings")) discrepancy.findings.push_back(finding_from_json(finding));
  for (JsonFields& cause : fields.objects("causes")) discrepancy.causes.push_back(cause_from_json(cause));
  for (JsonFields& candidate : fields.objects("candidates")) {
    discrepancy.candidates.push_back(candidate_from_json(candidate));
  }
  discrepancy.gain = gain_from_json(fields.object("gain"));
  if (fields.has("next_test")) discrepancy.next_test = next_test_from_json(fields.object("next_test"));
  return discrepancy;
}

}  // namespace valvetriage
