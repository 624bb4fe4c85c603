#pragma once

#include <string>
#include <string_view>

#include "core/classify/inference.h"
#include "core/classify/rule_base.h"
#include "server/wire/json.h"

namespace valvetriage {

/// Largest rule base accepted [bytes]: one of five levels with every input has some 250 rules and 40 kB.
inline constexpr std::size_t kMaxRuleBaseBytes = 1 << 20;

/// A rule base as schemas/rule_base.schema.json describes it, and back. Reading checks everything a user may rely on:
/// structure (`validate`) and soundness (`require_sound`), and sets `sha256`.
///
/// Errors  those of parse_json and JsonFields; `too_large`; `invalid_rule_base` with the JSON pointer in `field`;
///         `rule_base_uncovered`; `rule_base_not_monotone`
Result<RuleBase> rule_base_from_json(std::string_view text);
Json to_json(const RuleBase& base);

/// SHA-256 of the canonical JSON: equal for equal rule bases, however the file was formatted.
std::string rule_base_sha256(const RuleBase& base);

/// The rule bases that come with the product: `paper` (Eqs 21 to 23 as printed) and `calibrated` (set on Table I). Both
/// are schemas/rule-bases/NAME.json, embedded at build time.
///
/// Errors  `unknown_rule_base` for any other name
Result<RuleBase> embedded_rule_base(std::string_view name);

/// `{"verdict", "memberships", "per_level"}` of one valve. Where a level lacks an input of the rule base its
/// `inputs_missing` names it; where a level is missing the verdict is null and `reason` says so.
Json to_json(const Classification& classification);

/// `{"good", "malfunctioned", "severe"}`.
Json to_json(const Memberships& memberships);

/// `{"name", "version", "sha256"}`.
Json rule_base_identity(const RuleBase& base);

}  // namespace valvetriage
