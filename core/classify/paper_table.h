#pragma once

#include <array>
#include <cstdint>

#include "core/classify/verdict.h"

namespace valvetriage {

/// Levels of the paper's Table I, A.
inline constexpr double kPaperLow_a = 1.4, kPaperHigh_a = 1.6;

/// One row of the paper's Table I: Eq 20 of one valve at both levels. The paper prints no unit, rate or duration.
struct PaperTableRow {
  enum class Condition : std::uint8_t { kNew, kReturned };
  int valve_type;
  Condition condition;
  double error_low;   ///< at 1.4 A
  double error_high;  ///< at 1.6 A

  /// Section 4: new valves are Good, returned valves of type 2 Malfunctioned, of type 1 Severe.
  constexpr Verdict verdict() const {
    if (condition == Condition::kNew) return Verdict::kGood;
    return valve_type == 2 ? Verdict::kMalfunctioned : Verdict::kSevere;
  }
};

/// Table I, the paper's "80 sets of data": 40 rows of two errors, in its order.
inline constexpr auto kPaperTable = [] {
  using Condition = PaperTableRow::Condition;
  return std::array<PaperTableRow, 40>{{
      {1, Condition::kNew, 1.0156, 0.9048},      {1, Condition::kNew, 1.0030, 0.9174},
      {1, Condition::kNew, 1.0378, 0.9229},      {1, Condition::kNew, 1.0396, 0.8740},
      {1, Condition::kNew, 1.0233, 0.8837},      {1, Condition::kNew, 1.0611, 0.8788},
      {1, Condition::kNew, 1.0634, 0.8328},      {1, Condition::kNew, 1.0476, 0.9143},
      {1, Condition::kNew, 1.0536, 0.8498},      {1, Condition::kNew, 1.0249, 0.9128},
      {2, Condition::kNew, 1.0025, 0.8931},      {2, Condition::kNew, 0.9742, 0.8553},
      {2, Condition::kNew, 0.9740, 0.8388},      {2, Condition::kNew, 0.9810, 0.8046},
      {2, Condition::kNew, 0.9746, 0.8814},      {2, Condition::kNew, 0.9682, 0.8076},
      {2, Condition::kNew, 0.9704, 0.8168},      {2, Condition::kNew, 0.9704, 0.8321},
      {2, Condition::kNew, 0.9793, 0.7948},      {2, Condition::kNew, 0.9695, 0.8158},
      {1, Condition::kReturned, 1.8048, 1.0689}, {1, Condition::kReturned, 1.8048, 1.0659},
      {1, Condition::kReturned, 1.6242, 1.0763}, {1, Condition::kReturned, 1.5982, 1.0706},
      {1, Condition::kReturned, 1.6573, 1.1234}, {1, Condition::kReturned, 1.6254, 1.0779},
      {1, Condition::kReturned, 1.5485, 1.1019}, {1, Condition::kReturned, 1.6291, 1.0546},
      {1, Condition::kReturned, 1.7645, 1.0782}, {1, Condition::kReturned, 1.6671, 1.0934},
      {2, Condition::kReturned, 1.2697, 0.9865}, {2, Condition::kReturned, 1.2176, 1.0326},
      {2, Condition::kReturned, 1.3267, 1.0139}, {2, Condition::kReturned, 1.3357, 1.0078},
      {2, Condition::kReturned, 1.2477, 0.9998}, {2, Condition::kReturned, 1.2507, 1.0061},
      {2, Condition::kReturned, 1.1917, 1.0025}, {2, Condition::kReturned, 1.2510, 0.9852},
      {2, Condition::kReturned, 1.2268, 1.0106}, {2, Condition::kReturned, 1.2363, 0.9862},
  }};
}();

/// Eq 23, the crisp ranges of one level: Good below the first, Severe from the second on.
struct PaperCrispRanges {
  double malfunctioned_from;
  double severe_from;
};
inline constexpr PaperCrispRanges kPaperCrispLow{1.065, 1.535};
inline constexpr PaperCrispRanges kPaperCrispHigh{0.923, 1.041};

}  // namespace valvetriage
