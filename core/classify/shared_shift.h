#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

namespace valvetriage {

/// One figure over the population of good valves, as a reference learned it from a few of them.
struct GoodValves {
  double mean = 0;
  double sd = 0;   ///< valve to valve, ≥ 0
  int valves = 0;  ///< that mean and sd were learned from, 2 or more
};

/// How far all valves of a lot stand to one side of good ones.
struct SharedShift {
  double shift = 0;               ///< the lot's mean less that of good valves
  double std_error = 0;           ///< of both means
  double degrees_of_freedom = 0;  ///< of Student's t
  std::array<double, 2> ci95{};
  double p_value = 1;         ///< two-sided, of this figure alone
  double largest_single = 0;  ///< the farthest valve, in standard deviations of one more good valve
};

/// Fewest valves of a lot whose mean is compared.
inline constexpr int kFewestShiftValves = 3;

/// Whether the valves of a lot share a shift that none of them need show alone.
///
///   t = (m − μ) / √(max(s²_m, σ²/v) + σ²/n)
///
/// μ and σ are those of n good valves: a mean over few of them is uncertain, and t's tails say so. m is the mean of the
/// lot's v valves without a fifth at each end, s_m its standard error from the winsorised variance, so that one bad
/// valve is no shift of the lot. Few valves may lie close together by chance: they count as no surer than as many good
/// ones. Degrees of freedom: Welch's, but no more than the n − 1 of the good valves. Estimates that were drawn towards
/// the good valves (a prior) scatter less and lie nearer: they make the test slower to speak, never quicker.
///
/// values   one per valve, finite
/// Returns  nothing for fewer than kFewestShiftValves values or where neither scatters
/// Source   Yuen, Biometrika 61 (1974) 165; Welch, Biometrika 34 (1947) 28
/// Cost     O(n log n)
std::optional<SharedShift> shared_shift(std::span<const double> values, const GoodValves& good);

/// p-values paid for the number of figures tested: the chance that any of them is so small where nothing is shifted
/// (Holm, Scand. J. Statist. 6 (1979) 65). In the order given.
std::vector<double> holm_adjusted(std::span<const double> p_values);

}  // namespace valvetriage
