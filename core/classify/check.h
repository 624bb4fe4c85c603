#pragma once

#include <string>
#include <vector>

#include "core/classify/inference.h"

namespace valvetriage {

/// One thing that does not hold for a rule base, and exactly where.
///
/// kUncovered               faults: no rule fires on [from, to]
/// kVerdictNotMonotone      faults: a worse input gives a better verdict between from and to
/// kMembershipNotMonotone   noted: on [from, to] a worse error is more Good, or less Severe; the verdict is not touched
/// kConclusionDisagrees     noted: on [from, to] the crisp verdict is not the class of the largest membership
struct RuleBaseFinding {
  enum class Kind : std::uint8_t { kUncovered, kVerdictNotMonotone, kMembershipNotMonotone, kConclusionDisagrees } kind;
  std::string level;
  Quantity quantity = Quantity::kError;
  double from = 0, to = 0;  ///< unit of the quantity
  std::string text;         ///< one sentence for a person

  bool is_fault() const { return kind == Kind::kUncovered || kind == Kind::kVerdictNotMonotone; }
};

/// What a user may rely on: some rule fires everywhere in the input box (every input from 0 upwards, for every set of
/// inputs that may be missing), and a worse input never gives a better verdict.
///
/// Exact for coverage (between the corners of the sets it cannot change), for the memberships and for Eq 23's ranges of
/// the error; a verdict from the centroid is compared at every corner and densely between them.
/// Needs   a rule base that `validate` accepts
/// Cost    some 10⁴ inferences per level
std::vector<RuleBaseFinding> check_rule_base(const RuleBase& base);

/// The first fault as an Error: `rule_base_uncovered` or `rule_base_not_monotone`; notes are no Errors.
Result<void> require_sound(const RuleBase& base);

}  // namespace valvetriage
