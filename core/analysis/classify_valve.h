#pragma once

#include <optional>
#include <span>
#include <string>

#include "core/analysis/analysis.h"
#include "core/classify/rule_base.h"

namespace valvetriage {

/// What a verdict rests on.
struct VerdictInputs {
  std::span<const LevelFigures> by_level;
  BaselineKind baseline = BaselineKind::kSelf;
  bool valve_units = false;
  bool feedback = false;       ///< some recording shows a controller rather than the plant
  bool unstable = false;       ///< the baseline cannot be simulated
  std::string not_comparable;  ///< why the recordings cannot be compared with the reference; empty where they can
};

/// The verdict, or why there is none. Where several reasons hold, the one that no other file could mend comes first:
/// feedback, units, unstable, self_baseline, level_missing where hardly a sample is within the reference, no_rule_base,
/// level_missing of a single level.
///
/// action  Good: accept; Malfunctioned, Severe: reject; no verdict that a new recording would mend: retest
///         (feedback, units, unstable, level_missing); one that needs a reference or rule base: engineer
ClassificationResult classify_valve(const VerdictInputs& inputs, const std::optional<RuleBase>& rule_base);

/// Whether a rule base can judge recordings: it carries the rate, duration and unit of its Eq 20.
bool holds_for_recordings(const RuleBase& rule_base);

}  // namespace valvetriage
