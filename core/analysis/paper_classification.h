#pragma once

#include <array>
#include <cstddef>

#include "core/classify/inference.h"
#include "core/classify/paper_table.h"

namespace valvetriage {

/// In which of the four sets of Eq 22 (0 the left trapezoid … 3 the right one) the errors of a class have their largest
/// membership: counts, by level and verdict.
using SetCounts = std::array<std::array<std::size_t, 4>, kVerdictCount>;
SetCounts count_largest_sets(const LevelRules& level, bool low);

/// The largest Low error of a class that falls in the given set by its largest membership; 0 where none does.
double largest_error_in_set(const LevelRules& level, Verdict verdict, std::size_t set);

/// Smallest and largest membership in one set of Eq 22 over the High errors of a class.
struct StrengthRange {
  double smallest = 1, largest = 0;
};
std::array<StrengthRange, kVerdictCount> strengths_at_high(const LevelRules& level, std::size_t set);

/// Eq 23 on the 80 errors of Table I, as printed.
struct CrispCheck {
  std::size_t errors = 0;
  std::size_t wrong = 0;
  double largest_good_low = 0;   ///< against 1.065
  double largest_good_high = 0;  ///< against 0.923
};
CrispCheck check_crisp_ranges();

/// What Table I says before anything is classified.
struct TableStatistics {
  std::array<double, 2> good_mean_low{};          ///< by valve type
  std::array<double, 2> good_spread_low{};        ///< standard deviation over mean, by valve type
  double good_over_malfunctioned_low = 0;         ///< mean error of good valves over that of malfunctioned ones
  std::size_t returned_type_1_severe = 0;         ///< of 10, by Eq 23 at both levels
  std::size_t returned_type_2_malfunctioned = 0;  ///< of 10
};
TableStatistics table_statistics();

/// A rule base on Table I, each level of each row by itself: 80 sets.
struct TableScore {
  std::size_t sets = 0;
  std::size_t wrong = 0;
  std::size_t soft = 0;
};
TableScore score_table(const RuleBase& base);

}  // namespace valvetriage
