#pragma once

#include <span>
#include <vector>

namespace valvetriage {

/// Standard deviation of a signal's white noise, from the lower quartile of its third, sixth and ninth differences, the
/// least of them: the edges of steps do not count, and a sine up to a tenth of the sampling rate leaves nothing in the
/// ninth. 0 for fewer than eight samples.
double white_noise(std::span<const double> signal);

/// The signal without its white noise.
///
/// Each sample becomes the mean, or the middle of a parabola, over the widest window around it that agrees with those
/// of all narrower ones within their errors (intersection of confidence intervals: Goldenshluger and Nemirovski, Math.
/// Meth. Statist. 6 (1997) 135), whichever is the more certain. What moves faster than the noise stays as it was; a
/// signal without noise is returned to the last bit.
///
/// begins  first samples of stretches that no window reaches across, from 0 to the number of samples, increasing
/// Cost    O(n) for each window of means, O(n · length) for each of parabolas
std::vector<double> without_white_noise(std::span<const double> signal, std::span<const std::size_t> begins);

}  // namespace valvetriage
