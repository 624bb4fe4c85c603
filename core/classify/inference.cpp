#include "core/classify/inference.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace valvetriage {
namespace {

double combine(Aggregation aggregation, double a, double b) {
  return aggregation == Aggregation::kMaximum ? std::max(a, b) : a + b;
}

double aggregate(std::span<const FiredSet> fired, Implication implication, Aggregation aggregation, double z) {
  double height = 0;
  for (const auto& [shape, strength] : fired) {
    const double mu = membership(shape, z);
    height =
        combine(aggregation, height, implication == Implication::kMinimum ? std::min(strength, mu) : strength * mu);
  }
  return height;
}

/// Where a conclusion has a corner: those of its set, and where it is clipped.
void append_corners(const FiredSet& set, Implication implication, std::vector<double>& corners) {
  const Trapezoid& s = set.shape;
  corners.insert(corners.end(), {s.a, s.b, s.c, s.d});
  if (implication == Implication::kMinimum) {
    corners.push_back(s.a + set.strength * (s.b - s.a));
    corners.push_back(s.d - set.strength * (s.d - s.c));
  }
}

/// The linear piece of a conclusion inside an interval without corners, as its values at the ends.
struct Piece {
  double left, right;
};

Piece piece_inside(const FiredSet& set, Implication implication, double from, double to) {
  // Two inner points, since a vertical edge at an end has two values there.
  const FiredSet one[] = {set};
  const double third = (to - from) / 3;
  const double p = aggregate(one, implication, Aggregation::kMaximum, from + third);
  const double q = aggregate(one, implication, Aggregation::kMaximum, to - third);
  return {2 * p - q, 2 * q - p};
}

/// Corners of the aggregate: every corner of its parts and every crossing of two of them.
std::vector<double> aggregate_corners(std::span<const FiredSet> fired, Implication implication) {
  std::vector<double> corners;
  for (const FiredSet& set : fired) append_corners(set, implication, corners);
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  const std::size_t own = corners.size();
  for (std::size_t k = 0; k + 1 < own; ++k) {
    for (std::size_t i = 0; i < fired.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        const Piece f = piece_inside(fired[i], implication, corners[k], corners[k + 1]);
        const Piece g = piece_inside(fired[j], implication, corners[k], corners[k + 1]);
        const double at_left = f.left - g.left;
        const double at_right = f.right - g.right;
        if (at_left * at_right < 0) {
          corners.push_back(corners[k] + (corners[k + 1] - corners[k]) * at_left / (at_left - at_right));
        }
      }
    }
  }
  std::sort(corners.begin(), corners.end());
  return corners;
}

/// How many inputs the best informed rules ask about, of those rules whose inputs were all measured.
std::size_t best_informed(const LevelRules& level, const std::vector<std::optional<double>>& values) {
  std::size_t most = 0;
  for (const Rule& rule : level.rules) {
    std::size_t named = 0;
    bool measured = true;
    for (std::size_t i = 0; i < rule.sets.size(); ++i) {
      if (!rule.sets[i]) continue;
      ++named;
      measured = measured && values[i].has_value();
    }
    if (measured) most = std::max(most, named);
  }
  return most;
}

/// Firing strength of a rule, nothing where it does not take part.
std::optional<double> firing_strength(const RuleBase& base, const LevelRules& level, const Rule& rule,
                                      const std::vector<std::optional<double>>& values, std::size_t asked) {
  double strength = 1;
  std::size_t named = 0;
  for (std::size_t i = 0; i < rule.sets.size(); ++i) {
    if (!rule.sets[i]) continue;
    if (!values[i]) return std::nullopt;
    const double mu = membership(level.inputs[i].sets[*rule.sets[i]].shape, *values[i]);
    strength = base.conjunction == Conjunction::kMinimum ? std::min(strength, mu) : strength * mu;
    ++named;
  }
  if (named != asked) return std::nullopt;
  return strength;
}

Verdict crisp_verdict(const CrispRanges& crisp, double value) {
  if (value >= crisp.severe_from) return Verdict::kSevere;
  return value >= crisp.malfunctioned_from ? Verdict::kMalfunctioned : Verdict::kGood;
}

const LevelFeatures* find_level(std::span<const LevelFeatures> features, double level_a) {
  const auto same = [&](const LevelFeatures& f) { return std::abs(f.level_a - level_a) < kLevelTolerance; };
  const auto found = std::find_if(features.begin(), features.end(), same);
  return found == features.end() ? nullptr : &*found;
}

}  // namespace

std::optional<double> exact_centroid(std::span<const FiredSet> fired, Implication implication,
                                     Aggregation aggregation) {
  const std::vector<double> corners = aggregate_corners(fired, implication);
  double area = 0;
  double moment = 0;
  for (std::size_t k = 0; k + 1 < corners.size(); ++k) {
    const double from = corners[k];
    const double width = corners[k + 1] - from;
    if (width <= 0) continue;
    const double p = aggregate(fired, implication, aggregation, from + width / 3);
    const double q = aggregate(fired, implication, aggregation, from + 2 * width / 3);
    const double left = 2 * p - q;
    const double right = 2 * q - p;
    area += width * (left + right) / 2;
    moment += width * (from * (left + right) / 2 + width * (left + 2 * right) / 6);
  }
  if (!(area > 0)) return std::nullopt;
  return moment / area;
}

std::optional<double> value_of(const LevelFeatures& features, Quantity quantity) {
  switch (quantity) {
    case Quantity::kError:
      return features.error_eq20;
    case Quantity::kSettlingError:
      return features.settling_error ? std::optional(std::abs(*features.settling_error)) : std::nullopt;
    case Quantity::kRiseTime:
      return features.rise_time_s;
    case Quantity::kBandwidthTime:
      return features.bandwidth_hz ? std::optional(1 / (2 * std::numbers::pi * *features.bandwidth_hz)) : std::nullopt;
  }
  return std::nullopt;
}

Result<LevelClassification> classify_level(const RuleBase& base, const LevelRules& level,
                                           const LevelFeatures& features) {
  LevelClassification result{.level = level.name};
  std::vector<std::optional<double>> values;
  for (const FuzzyInput& input : level.inputs) {
    values.push_back(value_of(features, input.quantity));
    if (!values.back()) {
      result.inputs_missing.push_back(input.quantity);
    } else if (!std::isfinite(*values.back())) {
      return fail("not_finite",
                  fmt::format("{} at level {} is not a finite number", to_string(input.quantity), level.name));
    }
  }
  const std::size_t asked = best_informed(level, values);
  for (std::size_t r = 0; r < level.rules.size(); ++r) {
    const Rule& rule = level.rules[r];
    const auto strength = firing_strength(base, level, rule, values, asked);
    if (!strength) continue;
    result.rules.push_back({r, rule_text(level, rule), *strength});
    double& degree = result.memberships[index_of(rule.then)];
    degree = combine(base.aggregation, degree, *strength);
  }
  // Max over rules commutes with min(w, S) and with w S, a sum with w S, so one set per verdict carries the aggregate.
  std::vector<FiredSet> fired;
  for (const OutputSet& output : level.output)
    fired.push_back({output.shape, result.memberships[index_of(output.verdict)]});
  const auto centroid = exact_centroid(fired, base.implication, base.aggregation);
  if (!centroid) {
    return fail("no_rule_fires", fmt::format("rule base '{}', level {}: no rule fires at error {:g}", base.name,
                                             level.name, features.error_eq20));
  }
  result.centroid = *centroid;
  result.verdict =
      crisp_verdict(level.crisp, level.crisp.of == CrispRanges::Of::kError ? features.error_eq20 : *centroid);
  return result;
}

Result<Classification> classify(const RuleBase& base, std::span<const LevelFeatures> features) {
  Classification result;
  const LevelClassification* decides = nullptr;
  result.per_level.reserve(base.levels.size());
  for (const LevelRules& level : base.levels) {
    const LevelFeatures* measured = find_level(features, level.level_a);
    if (measured == nullptr) {
      result.missing_levels.push_back(level.name);
      continue;
    }
    auto classified = classify_level(base, level, *measured);
    if (!classified) return tl::unexpected(classified.error());
    result.per_level.push_back(std::move(*classified));
    const LevelClassification& added = result.per_level.back();
    const bool worse = decides == nullptr || added.verdict > decides->verdict ||
                       (added.verdict == decides->verdict && added.centroid > decides->centroid);
    if (worse) decides = &added;
  }
  if (!result.missing_levels.empty()) {
    result.reason = Unclassified::kLevelMissing;
    return result;
  }
  result.verdict = decides->verdict;
  result.memberships = decides->memberships;
  return result;
}

}  // namespace valvetriage
