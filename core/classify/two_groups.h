#pragma once

#include <cstdint>
#include <span>

namespace valvetriage {

/// Whether two groups of valves differ, without assuming how their values are distributed.

/// Two-sided p-value of the rank sum test (Wilcoxon; Mann and Whitney, Ann. Math. Statist. 18 (1947) 50): the chance
/// that ranks so unequal come from one population. Normal approximation with ties and continuity corrected.
///
/// a, b     values of the groups
/// Returns  NaN where a group has fewer than four values: nothing could be told
/// Cost     O(n log n)
double rank_sum_p_value(std::span<const double> a, std::span<const double> b);

/// Two-sided p-value of Fisher's exact test: the chance of a table at most as likely as this one, the margins given.
///
///            yes      no
///   group a  a_yes    a_no
///   group b  b_yes    b_no
///
/// counts   ≥ 0; 1 where a margin is empty
/// Cost     O(smallest margin)
double fisher_exact_p_value(std::int64_t a_yes, std::int64_t a_no, std::int64_t b_yes, std::int64_t b_no);

}  // namespace valvetriage
