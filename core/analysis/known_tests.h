#pragma once

#include <optional>
#include <span>
#include <vector>

#include "core/model/reference.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// A good valve's recordings and the free runs of its own fit, on the same samples.
struct FollowedValve {
  std::span<const Recording> recordings;
  std::span<const std::vector<double>> simulated;
};

/// What simulations of good valves leave in common, test by test: a stand plays every valve the same, and what no model
/// here follows of the one it does not follow of the next. Of each of the first valve's recordings the mean of what all
/// valves leave, as far as it stands out from their scatter and their noise: of its Haar coefficients those beyond the
/// largest that so many would have by chance (Donoho and Johnstone, Biometrika 81 (1994) 425), the rest set to none.
///
/// Returns  one per recording whose input every valve was played; none unless all recordings of all valves are such
/// Cost     O(samples · valves)
std::vector<KnownTest> known_tests(std::span<const FollowedValve> valves);

/// What good valves leave in these tests [psi], one value a sample; none unless all recordings are of known tests: the
/// same input, to a fiftieth of its deviation, on the same clock, begun up to kMostShift samples sooner or later.
std::optional<std::vector<std::vector<double>>> left_in_common(std::span<const Recording> recordings,
                                                               std::span<const KnownTest> tests);

inline constexpr int kMostShift = 50;

/// Takes off what good valves leave in common.
void take_off(std::span<const std::vector<double>> common, std::vector<Recording>& recordings);
/// Puts it back, where `common` holds anything.
void put_back(std::span<const std::vector<double>> common, std::vector<std::vector<double>>& runs);

}  // namespace valvetriage
