#include "core/classify/rule_base.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <set>

namespace valvetriage {
namespace {

tl::unexpected<Error> invalid(std::string pointer, const std::string& what) {
  Error error{.code = "invalid_rule_base"};
  error.message = fmt::format("{}: {}", pointer.empty() ? "the rule base" : pointer, what);
  error.field = std::move(pointer);
  return tl::unexpected(std::move(error));
}

Result<void> validate_inputs(const LevelRules& level, const std::string& at) {
  std::set<Quantity> seen;
  for (std::size_t i = 0; i < level.inputs.size(); ++i) {
    const FuzzyInput& input = level.inputs[i];
    const std::string here = fmt::format("{}/inputs/{}", at, i);
    if (!seen.insert(input.quantity).second) {
      return invalid(here, fmt::format("{} stands twice among the inputs", to_string(input.quantity)));
    }
    if (input.sets.empty()) return invalid(here, "an input needs at least one set");
    std::set<std::string> names;
    for (std::size_t s = 0; s < input.sets.size(); ++s) {
      const std::string set_at = fmt::format("{}/sets/{}", here, s);
      if (!names.insert(input.sets[s].name).second) {
        return invalid(set_at, fmt::format("the name '{}' stands twice", input.sets[s].name));
      }
      if (!is_trapezoid(input.sets[s].shape)) {
        return invalid(set_at,
                       "points must be a <= b <= c <= d, null only as an open shoulder (the first or last two)");
      }
    }
  }
  if (!seen.contains(Quantity::kError)) return invalid(at + "/inputs", "the input 'error' is missing");
  return {};
}

Result<void> validate_output(const LevelRules& level, const std::string& at) {
  std::set<Verdict> seen;
  for (std::size_t i = 0; i < level.output.size(); ++i) {
    const auto& [verdict, shape] = level.output[i];
    const std::string here = fmt::format("{}/output/{}", at, i);
    if (!seen.insert(verdict).second) return invalid(here, fmt::format("{} stands twice", to_string(verdict)));
    const bool finite = std::isfinite(shape.a) && std::isfinite(shape.d);
    if (!is_trapezoid(shape) || !finite || !(shape.a < shape.d)) {
      return invalid(here, "points of an output set must be finite numbers a <= b <= c <= d with a < d");
    }
  }
  for (std::size_t i = 0; i < level.rules.size(); ++i) {
    if (!seen.contains(level.rules[i].then)) {
      return invalid(fmt::format("{}/rules/{}", at, i),
                     fmt::format("concludes {}, which has no output set", to_string(level.rules[i].then)));
    }
  }
  return {};
}

Result<void> validate_rules(const LevelRules& level, const std::string& at) {
  if (level.rules.empty()) return invalid(at + "/rules", "a level needs at least one rule");
  for (std::size_t r = 0; r < level.rules.size(); ++r) {
    const Rule& rule = level.rules[r];
    const std::string here = fmt::format("{}/rules/{}", at, r);
    if (rule.sets.size() != level.inputs.size()) {
      return invalid(here, fmt::format("names {} sets for {} inputs", rule.sets.size(), level.inputs.size()));
    }
    for (std::size_t i = 0; i < rule.sets.size(); ++i) {
      if (rule.sets[i] && *rule.sets[i] >= level.inputs[i].sets.size())
        return invalid(here, "names a set that is not there");
      if (!rule.sets[i] && level.inputs[i].quantity == Quantity::kError) {
        return invalid(here, "every rule asks about 'error'");
      }
    }
  }
  return {};
}

Result<void> validate_level(const LevelRules& level, const std::string& at) {
  if (!std::isfinite(level.level_a)) return invalid(at + "/level_A", "is not a finite current in A");
  const auto [of, malfunctioned_from, severe_from] = level.crisp;
  if (std::isnan(malfunctioned_from) || std::isnan(severe_from) || malfunctioned_from > severe_from) {
    return invalid(at + "/crisp", "needs malfunctioned_from <= severe_from");
  }
  return validate_inputs(level, at).and_then([&] { return validate_rules(level, at); }).and_then([&] {
    return validate_output(level, at);
  });
}

}  // namespace

std::string_view to_string(Quantity quantity) {
  switch (quantity) {
    case Quantity::kError:
      return "error";
    case Quantity::kSettlingError:
      return "settling_error";
    case Quantity::kRiseTime:
      return "rise_time_s";
    case Quantity::kBandwidthTime:
      return "bandwidth_time_s";
  }
  return "";
}

std::optional<Quantity> quantity_from(std::string_view name) {
  for (const Quantity quantity : kQuantities) {
    if (name == to_string(quantity)) return quantity;
  }
  return std::nullopt;
}

std::string level_name(double level_a) {
  if (std::abs(level_a - 1.4) < kLevelTolerance) return "low";
  if (std::abs(level_a - 1.6) < kLevelTolerance) return "high";
  return fmt::format("{:g}", level_a);
}

std::optional<double> level_from_name(std::string_view name) {
  if (name == "low") return 1.4;
  if (name == "high") return 1.6;
  if (name.ends_with('A')) name.remove_suffix(1);
  double level = 0;
  const auto [end, problem] = std::from_chars(name.data(), name.data() + name.size(), level);
  if (problem != std::errc{} || end != name.data() + name.size() || !std::isfinite(level)) return std::nullopt;
  return level;
}

std::string rule_text(const LevelRules& level, const Rule& rule) {
  std::string text;
  for (std::size_t i = 0; i < rule.sets.size(); ++i) {
    if (!rule.sets[i]) continue;
    const FuzzyInput& input = level.inputs[i];
    text += fmt::format("{}{} is {}", text.empty() ? "" : " and ", to_string(input.quantity),
                        input.sets[*rule.sets[i]].name);
  }
  return fmt::format("{} -> {}", text, to_string(rule.then));
}

Result<void> validate(const RuleBase& base) {
  if (base.name.empty()) return invalid("/name", "a rule base needs a name");
  if (base.levels.empty()) return invalid("/levels", "a rule base needs at least one level");
  if (base.window && !(base.window->rate_hz > 0 && base.window->duration_s > 0)) {
    return invalid("/rate_hz", "rate_hz and duration_s must be positive");
  }
  for (std::size_t i = 0; i < base.levels.size(); ++i) {
    const std::string at = fmt::format("/levels/{}", i);
    for (std::size_t j = 0; j < i; ++j) {
      const bool same_level = std::abs(base.levels[i].level_a - base.levels[j].level_a) < kLevelTolerance;
      if (same_level || base.levels[i].name == base.levels[j].name) return invalid(at, "this level stands twice");
    }
    if (auto level = validate_level(base.levels[i], at); !level) return level;
  }
  return {};
}

}  // namespace valvetriage
