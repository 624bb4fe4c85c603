#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "core/model/static_map.h"

namespace valvetriage {

/// Index of the knot nearest to an input, of n ≥ 2 evenly spaced ones; the end ones beyond.
std::size_t nearest_knot(const std::vector<double>& knots, double input);

/// The smooth curve through a valve's map knots: cubic between them, its slope at a knot half the way of its neighbours
/// (at an end that of the parabola through three). Linear in the outputs, each of which acts on four pieces. Source:
/// Catmull, Rom, in Computer Aided Geometric Design (1974) 317.
///
/// Straight pieces of 25 mA lie 0.2 psi off a valve's map where it bends most, half of a gauge's noise. The curve is
/// run and stored as straight pieces an eighth as long, a 64th as far off.
class KnotCurve {
 public:
  static constexpr std::size_t kPieces = 8;  ///< straight ones between two knots

  /// knots  n ≥ 2 inputs, evenly spaced
  explicit KnotCurve(const std::vector<double>& knots);

  /// How much each of four neighbouring knots' outputs takes part in the output at an input.
  struct Share {
    std::size_t first = 0;           ///< knot of the first weight
    std::array<double, 4> weight{};  ///< 0 for a knot that there is none of
  };
  Share share_at(double input) const;

  /// The curve through outputs, one per knot. It may overshoot a little beside a flat piece.
  StaticMap through(const std::vector<double>& outputs) const;
  /// The same made to fall nowhere, for a model that is handed out: the nearest such map in least squares.
  StaticMap rising_through(const std::vector<double>& outputs) const;

 private:
  std::vector<double> fine_input_;
  std::vector<Share> fine_;  ///< at each end of the straight pieces
};

}  // namespace valvetriage
