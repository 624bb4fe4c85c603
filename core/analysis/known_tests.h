#pragma once

#include <Eigen/Core>
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
/// here follows of the one it does not follow of the next.
///
/// A test is an input that every valve was played. Its residual is the mean of what the valves leave, of the Haar
/// coefficients of that mean those that exceed the largest that noise would show in so many (Donoho and Johnstone,
/// Biometrika 81 (1994) 425). What a few valves scatter by exceeds it more often: whether the mean is worth taking off,
/// valves that had no part in it tell.
class CommonResiduals {
 public:
  /// Cost  O(samples · valves · tests · shifts)
  explicit CommonResiduals(std::span<const FollowedValve> valves);

  /// Of all valves.
  std::vector<KnownTest> of_all() const { return without(std::nullopt); }
  /// Of all but one: what is expected of that one. Cost O(samples · valves)
  std::vector<KnownTest> of_others(std::size_t valve) const { return without(valve); }

 private:
  struct Test {
    double sample_period_s = 0;
    std::vector<double> input;
    Eigen::MatrixXd coefficients;  ///< one column per valve, a power of two of rows
    double noise_square = 0;       ///< of one recording [psi²]
  };
  std::vector<KnownTest> without(std::optional<std::size_t> valve) const;

  std::vector<Test> tests_;
};

/// Samples by which a recording may begin sooner or later than the test it is of.
inline constexpr int kMostShift = 50;

/// What good valves leave in a recording [psi], one value a sample; empty where it is of no known test: the same input,
/// to a fiftieth of its deviation or what a meter of current is uncertain by, on the same clock, begun up to kMostShift
/// samples sooner or later. Samples that are not valid and those that a jump may fall into do not count. To the last
/// digit of the reading, and none of a reading that never moves.
std::vector<double> left_in_common(const Recording& recording, std::span<const KnownTest> tests);

/// The same of each of several; none unless all of them are of known tests.
std::optional<std::vector<std::vector<double>>> all_left_in_common(std::span<const Recording> recordings,
                                                                   std::span<const KnownTest> tests);

/// Takes off what good valves leave in common.
void take_off(std::span<const double> common, Recording& recording);
/// Puts it back into a simulation of what is left.
void put_back(std::span<const double> common, std::vector<double>& run);

}  // namespace valvetriage
