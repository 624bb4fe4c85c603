#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/classify/rule_base.h"

namespace valvetriage {

/// A conclusion with the strength that fired it.
struct FiredSet {
  Trapezoid shape;      ///< finite corners
  double strength = 0;  ///< 0 to 1
};

/// Centre of gravity of the aggregated conclusion, exact: the aggregate is piecewise linear and is integrated piece by
/// piece between its corners and crossings, not sampled.
///
///   μ(z) = max_i min(w_i, S_i(z))  or  max_i w_i S_i(z)  or sums in place of max     z* = ∫ z μ(z) dz / ∫ μ(z) dz
///
/// Source   Mamdani and Assilian, Int. J. Man-Machine Studies 7 (1975) 1; centre of gravity as in Lee, IEEE SMC 20
/// (1990) Range    inside the union of the supports that fired; nothing where no strength is positive Cost     O(m³)
/// for m sets (at most 3 here)
std::optional<double> exact_centroid(std::span<const FiredSet> fired, Implication implication,
                                     Aggregation aggregation = Aggregation::kMaximum);

/// What is known of a valve at one current level.
///
/// error_eq20      Eq 20, [unit of the output / s], ≥ 0
/// settling_error  |measured − simulated| at the end of the window; its magnitude counts
/// rise_time_s     10 to 90 % of the measured rise
/// bandwidth_hz    −3 dB, of a sweep around the level, > 0. Rules ask about its time 1 / (2π bandwidth), the time
///                 constant of a single lag of that bandwidth: like the other quantities it is worse when larger
struct LevelFeatures {
  double level_a = 0;
  double error_eq20 = 0;
  std::optional<double> settling_error{};
  std::optional<double> rise_time_s{};
  std::optional<double> bandwidth_hz{};
};

/// The value of a quantity, nothing where it was not measured.
std::optional<double> value_of(const LevelFeatures& features, Quantity quantity);

/// A rule that took part, and how strongly it fired.
struct FiredRule {
  std::size_t rule = 0;  ///< index into LevelRules::rules
  std::string text;      ///< the rule in words
  double strength = 0;   ///< 0 to 1
};

struct LevelClassification {
  std::string level;  ///< name of the level in the rule base
  Verdict verdict = Verdict::kGood;
  Memberships memberships{};  ///< per class, the strongest rule that concludes it, or the sum of them (aggregation)
  double centroid = 0;        ///< defuzzified value on the output axis
  std::vector<FiredRule> rules{};          ///< every rule that took part, also those at strength 0
  std::vector<Quantity> inputs_missing{};  ///< known to the rule base, not measured here
};

/// A soft error (paper section 4): Malfunctioned taken for Severe or the reverse, or the right verdict although the
/// largest membership is another class's. Good taken for bad or the reverse is a hard error.
constexpr bool is_soft_error(Verdict truth, Verdict verdict, const Memberships& memberships) {
  if (verdict == truth) return largest_membership(memberships) != truth;
  return verdict != Verdict::kGood && truth != Verdict::kGood;
}
constexpr bool is_hard_error(Verdict truth, Verdict verdict) {
  return (truth == Verdict::kGood) != (verdict == Verdict::kGood);
}

/// Why a valve has no verdict.
enum class Unclassified : std::uint8_t { kLevelMissing };

/// One valve's verdict: the worse of its levels.
///
/// verdict      empty where a level of the rule base was not measured; `reason` and `missing_levels` say so
/// memberships  of the level that decides: the worst verdict, among equals the largest centroid
struct Classification {
  std::optional<Verdict> verdict;
  std::optional<Unclassified> reason;
  std::vector<std::string> missing_levels;
  Memberships memberships{};
  std::vector<LevelClassification> per_level;  ///< in the rule base's order, measured levels only
};

/// Classifies one level by Mamdani inference.
///
/// Where an input of the rule base was not measured, the rules that ask about it keep silent; of the others, those that
/// ask about the most inputs take part. A learned rule base carries rules for every set of inputs, so that it still
/// classifies.
///
/// Errors  `not_finite`; `no_rule_fires` where the rule base has a hole (check_rule_base finds holes beforehand)
Result<LevelClassification> classify_level(const RuleBase& base, const LevelRules& level,
                                           const LevelFeatures& features);

/// Classifies one valve. Levels are matched within kLevelTolerance; measured levels that the rule base does not know
/// are left out. Pure, thread-safe; cost linear in the number of rules.
Result<Classification> classify(const RuleBase& base, std::span<const LevelFeatures> features);

}  // namespace valvetriage
