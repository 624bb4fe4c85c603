#pragma once

#include <cstddef>
#include <functional>
#include <span>
#include <vector>

namespace valvetriage {

/// A gain of what is measured over what is simulated that is one before a sample and another from it on.
struct GainSplit {
  std::size_t sample = 0;
  double change = 0;  ///< of the gain, relative
  double taken = 0;   ///< of the measured squares, more than one gain for all takes
};

/// Every sample of a recording with the best gains on either side of it, in order, where both are positive. Bai,
/// Econometric Theory 13 (1997) 315. simulated, measured  of one length; is_valid  whether a sample takes part
std::vector<GainSplit> split_gains(std::span<const double> simulated, std::span<const double> measured,
                                   const std::function<bool(std::size_t)>& is_valid);

}  // namespace valvetriage
