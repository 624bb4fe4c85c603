#include "core/analysis/classify_valve.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <vector>

#include "core/classify/inference.h"

namespace valvetriage {
namespace {

ClassificationResult none(NoVerdict reason, std::string explanation, std::string action) {
  ClassificationResult result;
  result.reason = reason;
  result.explanation = std::move(explanation);
  result.action = std::move(action);
  return result;
}

std::optional<ClassificationResult> obstacle(const VerdictInputs& inputs, const std::optional<RuleBase>& rule_base) {
  if (inputs.feedback) {
    return none(
        NoVerdict::kFeedback,
        "the input follows the output: the recording shows a controller rather than the valve; record it in open loop",
        "retest");
  }
  if (!inputs.valve_units) {
    return none(NoVerdict::kUnits,
                "input and output are not a current and a pressure, and a verdict is defined for those alone",
                "retest");
  }
  if (inputs.unstable) {
    return none(NoVerdict::kUnstable,
                "the baseline is unstable, so it cannot be simulated and leaves no residual to judge", "retest");
  }
  if (inputs.baseline != BaselineKind::kReference) {
    return none(NoVerdict::kSelfBaseline,
                "the valve was compared with a model of its own recordings; a verdict needs a reference learned from "
                "good valves",
                "engineer");
  }
  if (!inputs.not_comparable.empty()) return none(NoVerdict::kLevelMissing, inputs.not_comparable, "retest");
  if (!rule_base) {
    return none(NoVerdict::kNoRuleBase, "no rule base was given; learn one from labelled valves of this stand",
                "engineer");
  }
  if (!holds_for_recordings(*rule_base)) {
    return none(
        NoVerdict::kNoRuleBase,
        fmt::format("rule base '{}' has no sampling rate and duration, so it holds for tables only", rule_base->name),
        "engineer");
  }
  return std::nullopt;
}

std::map<std::string, double> named(const Memberships& memberships) {
  std::map<std::string, double> by_name;
  for (const Verdict verdict : kVerdicts) {
    std::string name(to_string(verdict));
    name.front() = static_cast<char>(name.front() - 'A' + 'a');
    by_name[name] = memberships[index_of(verdict)];
  }
  return by_name;
}

LevelVerdict level_verdict(const LevelClassification& level) {
  LevelVerdict verdict{.level = level.level, .verdict = std::string(to_string(level.verdict))};
  verdict.memberships = named(level.memberships);
  for (const FiredRule& rule : level.rules) verdict.rules.emplace_back(rule.text, rule.strength);
  return verdict;
}

std::vector<LevelFeatures> features_of(std::span<const LevelFigures> by_level) {
  std::vector<LevelFeatures> features;
  for (const LevelFigures& level : by_level) {
    if (!level.error_eq20) continue;
    features.push_back({level.level_a, *level.error_eq20, level.settling_error, level.rise_time_s, level.bandwidth_hz});
  }
  return features;
}

ClassificationResult judged(const Classification& classification) {
  ClassificationResult result;
  for (const LevelClassification& level : classification.per_level) result.per_level.push_back(level_verdict(level));
  if (!classification.verdict) {
    std::vector<std::string> currents;
    for (const std::string& name : classification.missing_levels) {
      const auto level_a = level_from_name(name);
      currents.push_back(level_a ? fmt::format("{:g} A", *level_a) : name);
    }
    result.reason = NoVerdict::kLevelMissing;
    result.explanation = fmt::format("no covered step at the level{} {} of the rule base",
                                     currents.size() == 1 ? "" : "s", fmt::join(currents, ", "));
    result.action = "retest";
    return result;
  }
  result.verdict = std::string(to_string(*classification.verdict));
  result.memberships = named(classification.memberships);
  result.action = *classification.verdict == Verdict::kGood ? "accept" : "reject";
  return result;
}

}  // namespace

bool holds_for_recordings(const RuleBase& rule_base) {
  return rule_base.window.has_value();
}

ClassificationResult classify_valve(const VerdictInputs& inputs, const std::optional<RuleBase>& rule_base) {
  ClassificationResult result;
  if (auto hindered = obstacle(inputs, rule_base)) {
    result = std::move(*hindered);
  } else {
    const auto classification = classify(*rule_base, features_of(inputs.by_level));
    result = classification ? judged(*classification)
                            : none(NoVerdict::kLevelMissing, classification.error().message, "engineer");
  }
  if (rule_base) {
    result.rule_base_name = rule_base->name;
    result.rule_base_version = rule_base->version;
    result.rule_base_sha256 = rule_base->sha256;
  }
  return result;
}

}  // namespace valvetriage
