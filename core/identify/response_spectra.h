#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

#include "core/identify/frequency_response.h"

namespace valvetriage {

/// Lines of one repeat: input and output without their means, transformed.
struct RecordSpectra {
  std::vector<std::complex<double>> input, output;
  double line_hz = 0;  ///< distance between lines
};

/// What both estimators give back: points before any is refused.
struct ResponseEstimate {
  std::vector<ResponsePoint> points;
  std::vector<UnusableBand> unusable;
};

/// Local polynomials over windows of lines: see estimate_frequency_response. Points are in samples, not yet corrected
/// for the hold.
ResponseEstimate estimate_by_local_polynomials(std::span<const RecordSpectra> records, double highest_hz,
                                               int points_per_decade);

/// Excited lines of a periodic input one by one: see estimate_frequency_response.
///
/// records  spectra of a whole number of periods, all of the same length
/// periods  in each record, ≥ 2
struct PeriodicEstimate {
  ResponseEstimate response;
  std::optional<Distortion> distortion;
};
PeriodicEstimate estimate_by_periods(std::span<const RecordSpectra> records, std::size_t periods, double highest_hz,
                                     int points_per_decade);

/// Fewer points where there are more than the wanted number per decade: parabolas through groups of neighbours, read at
/// three nodes.
std::vector<ResponsePoint> thinned(std::vector<ResponsePoint> points, int points_per_decade);

/// Nodes of the three-point Gauss-Legendre rule on [−1, 1]: 0 and ± this.
inline constexpr double kGaussNode = 0.7745966692414834;

}  // namespace valvetriage
