#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/classify/membership.h"
#include "core/classify/verdict.h"
#include "core/result.h"

namespace valvetriage {

/// What a rule may ask about. `kError` is Eq 20 and always there; the others are used where they were measured.
enum class Quantity : std::uint8_t { kError, kSettlingError, kRiseTime, kBandwidthTime };

inline constexpr std::array<Quantity, 4> kQuantities{Quantity::kError, Quantity::kSettlingError, Quantity::kRiseTime,
                                                     Quantity::kBandwidthTime};

/// `error`, `settling_error`, `rise_time_s`, `bandwidth_time_s`: as rule bases spell them.
std::string_view to_string(Quantity quantity);
std::optional<Quantity> quantity_from(std::string_view name);

struct InputSet {
  std::string name;
  Trapezoid shape;

  bool operator==(const InputSet&) const = default;
};

/// A fuzzy variable of a level: a quantity with its sets, from the best to the worst.
struct FuzzyInput {
  Quantity quantity = Quantity::kError;
  std::vector<InputSet> sets{};

  bool operator==(const FuzzyInput&) const = default;
};

/// A fuzzy conclusion: where a verdict lies on the output axis.
struct OutputSet {
  Verdict verdict = Verdict::kGood;
  Trapezoid shape;  ///< finite corners, a < d

  bool operator==(const OutputSet&) const = default;
};

/// "if error is X and rise time is Y then V". `sets[i]` is an index into `inputs[i].sets`, or nothing where the rule
/// does not ask about that input.
struct Rule {
  std::vector<std::optional<std::size_t>> sets{};
  Verdict then = Verdict::kGood;

  bool operator==(const Rule&) const = default;
};

/// The crisp ranges after defuzzification (Eq 23): Good below `malfunctioned_from`, Severe from `severe_from` on.
///
/// of  kCentroid  the defuzzified value decides: verdict and memberships agree
///     kError     Eq 20 itself decides, as Eq 23 is printed; the fuzzy part then only says how much
struct CrispRanges {
  enum class Of : std::uint8_t { kCentroid, kError } of = Of::kCentroid;
  double malfunctioned_from = 0;
  double severe_from = 0;

  bool operator==(const CrispRanges&) const = default;
};

/// The fuzzy system of one current level.
struct LevelRules {
  std::string name;    ///< key of `per_level`: "low" (1.4 A), "high" (1.6 A), else the level, "1.8"
  double level_a = 0;  ///< current level [A]
  std::vector<FuzzyInput> inputs{};
  std::vector<OutputSet> output{};
  std::vector<Rule> rules{};
  CrispRanges crisp{};

  bool operator==(const LevelRules&) const = default;
};

/// How the degrees of one rule's conditions become its firing strength: min or product.
enum class Conjunction : std::uint8_t { kMinimum, kProduct };

/// How a firing strength acts on the rule's conclusion: the output set is clipped (Mamdani) or scaled (Larsen).
enum class Implication : std::uint8_t { kMinimum, kProduct };

/// How the conclusions of several rules become one: the upper envelope (Mamdani), or their sum (Kosko's standard
/// additive model, which interpolates between the conclusions of a monotone rule table and so is itself monotone).
enum class Aggregation : std::uint8_t { kMaximum, kSum };

/// At which rate and over which window Eq 20 was computed for this rule base; there is no conversion afterwards.
struct FeatureWindow {
  double rate_hz = 0;
  double duration_s = 0;
  std::string unit;  ///< of the output, "psi"

  bool operator==(const FeatureWindow&) const = default;
};

/// A versioned fuzzy classifier (Mamdani and Assilian 1975; paper section 3).
///
/// window  absent: the rule base holds for tables only (`paper`, `calibrated`)
/// sha256  of the canonical JSON, set by server/wire
struct RuleBase {
  std::string name;
  std::string version;
  std::string description{};
  std::string sha256{};
  std::optional<FeatureWindow> window{};
  Conjunction conjunction = Conjunction::kMinimum;
  Implication implication = Implication::kMinimum;
  Aggregation aggregation = Aggregation::kMaximum;
  std::vector<LevelRules> levels{};
};

/// Two levels closer than this are the same level [A]. Recordings hold a level to a few mA, levels lie 0.05 A apart or
/// more.
inline constexpr double kLevelTolerance = 0.02;

/// The name of a level: "low" at 1.4 A, "high" at 1.6 A (paper section 3.1), else the current in A, "1.8".
std::string level_name(double level_a);

/// The level of a name: the inverse of level_name, with or without "A" after a number; nothing for other text.
std::optional<double> level_from_name(std::string_view name);

/// The rules in words: "error is good and rise_time_s is severe -> Severe".
std::string rule_text(const LevelRules& level, const Rule& rule);

/// Whether the parts of a rule base fit together: sets are trapezoids, rules name sets that exist, every verdict that a
/// rule concludes has an output set, levels are distinct, crisp ranges ordered, window positive.
///
/// Errors  `invalid_rule_base` with the JSON pointer of the part in `field`
Result<void> validate(const RuleBase& base);

}  // namespace valvetriage
