#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage {

/// A stretch on which the input rests and its log is coarse: rounding is one value there, and what was commanded lies
/// beside what was logged by as much throughout. [A²]
struct CoarseRest {
  std::size_t begin = 0, end = 0;  ///< samples
  double variance = 0;             ///< of the input's unknown offset, its unit squared
};

/// The spacing of the codes in which the inputs of a valve's recordings are logged, as sweeps show it; 0 where none
/// does: levels and ramps may have been commanded in equal steps, and what is resampled has no codes.
double input_quantum(std::span<const Recording> recordings);

/// Rests of a recording and how far off its logged input may be on each. Noise ahead of the rounding shows what lies
/// between two codes: of an error that is uniform over a quantum q it leaves exp(−4π² σ² / q²) of the variance, by the
/// first term of its Fourier series (Widrow and Kollar, Quantization Noise, 2008, chapter 7). Empty where that is
/// nothing.
std::vector<CoarseRest> coarse_rests(const Recording& recording, double quantum);

}  // namespace valvetriage
