#pragma once

#include <span>

#include "core/recording/recording.h"

namespace valvetriage {

/// How a noise floor was measured.
///
/// kHolds        on the settled ends of holds, where the output should stand still: sees coloured noise as well
/// kDifferences  from third differences: right for white noise, too small for coloured noise
/// kPrediction   what a linear prediction from the past of input and output leaves: where the signal is fast against
///               the sampling, so that differences would take it for noise
enum class NoiseFloorMethod : std::uint8_t { kHolds, kDifferences, kPrediction };

struct NoiseFloor {
  double rms = 0;  ///< unit of the output
  NoiseFloorMethod method = NoiseFloorMethod::kDifferences;
  std::size_t samples = 0;  ///< that it rests on
};

/// The least that a reading moves by between valid samples, its last digit where it is quantised [unit of the output];
/// 0 where it never moves.
double smallest_step(const Recording& recording);

/// Rms of the noise that no model of the input can explain, without taking dynamics for noise: a step's transient, a
/// ramp and a sweep leave no trace in it.
///
/// Holds: the last part of each hold that is long enough, minus its own straight line (what is left of a slow tail),
/// its mean square corrected for the two freedoms; the median over holds, so that one that is still settling does not
/// count. Differences: (y_t − 3 y_{t−1} + 3 y_{t−2} − y_{t−3}) / √20 removes any local parabola; its robust scale
/// (median absolute deviation) is the noise as long as the signal is slow against the sampling.
///
/// Quantised outputs: at least one quantisation step over √12 of the smallest step seen, so that a frozen reading is
/// not called noise-free. Cost  O(n)
NoiseFloor noise_floor(const Recording& recording);

/// The same for a machine that may ring from one step to the next, so that its holds have not settled and show its
/// transients. `simulated` is a free run of the recording, one value per sample: holds in which that still moves are
/// left out. The others count where they agree with one another, as parts of one stationary noise do, up to what
/// coloured noise can be above the part of it that a prediction leaves; where they do not agree, or are too few to
/// tell, the least of all estimates is the floor: a transient only adds to it.
NoiseFloor noise_floor_of_ringing(const Recording& recording, std::span<const double> simulated);

}  // namespace valvetriage
