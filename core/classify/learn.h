#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/classify/inference.h"

namespace valvetriage {

/// A valve whose class is known (by teardown, or by an older test), with its figures per level.
struct LabelledValve {
  Verdict verdict = Verdict::kGood;
  std::vector<LevelFeatures> levels;
};

/// window              rate, duration and unit the errors were computed at; without it the base holds for tables only
/// fewest_per_class    valves a class needs at a level; below three there are no quartiles to speak of
struct LearnOptions {
  std::string name = "learned";
  std::string version = "1";
  std::string description{};
  std::optional<FeatureWindow> window{};
  std::size_t fewest_per_class = 3;
};

/// base    sound in the sense of check_rule_base
/// wrong   how many of the labelled valves the base itself gets wrong (on the data it was set on: no evidence)
/// notes   what was left out and why, one sentence each: a missing class, a level or an input that does not separate
struct LearnedRuleBase {
  RuleBase base;
  std::size_t wrong = 0;
  std::vector<std::string> notes;
};

/// A rule base from labelled valves.
///
/// Per level and quantity, the sets of neighbouring classes cross half way between the upper quartile of the better
/// class and the lower quartile of the worse one; each ramp runs from the one quartile to the other, so that the
/// degrees of two neighbours add up to 1 and a wide overlap gives a wide ramp. Quartiles, since extremes of a few
/// valves move with every valve.
///
/// A valve is as bad as its worst level. Where some level on its own does not separate the classes (a fault may show at
/// one level only), the crossings of all levels are placed together: each error is taken relative to the upper quartile
/// of the better class at its level, a valve's score is the largest of these, and the crossing is the geometric middle
/// between the scores' quartiles. So the levels a fault does not show at are not drawn into the good valves.
///
/// Settling error, rise time and the time of the bandwidth join where they separate the classes in the same order; a
/// rule then concludes the weighted mean of its sets, weights by how well each separates (Somers' D). Rules for every
/// set of measured inputs are in the base, so that it still classifies where one is absent.
///
/// With only two classes labelled it is a two-class base, and a note says so.
/// Errors   `too_few_labels` (Good and at least one other class, each with fewest_per_class valves),
///          `level_missing` (no level with enough valves of every class), `not_finite`
/// Cost     O(levels · n log n) and the check; deterministic
Result<LearnedRuleBase> learn_rule_base(std::span<const LabelledValve> valves, const LearnOptions& options);

/// Linear interpolation between order statistics (Hyndman and Fan's type 7); values need not be sorted, at least one.
double quantile(std::vector<double> values, double probability);

}  // namespace valvetriage
