#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/model/static_map.h"
#include "core/model/transfer_function.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// What `simulate` runs and an Analysis stores: input delay -> static map (or affine) -> linear dynamics -> offset.
///
///   v(t) = map(u(t − delay))        or  u(t) itself where there is no map
///   y(t) = G v(t) + output_offset
///
/// With a map, `dynamics` has static gain 1 and the map carries the unit; without, G carries gain and delay, and
/// `input_offset` is subtracted from u (the operating point of an affine baseline).
struct Model {
  std::string kind;                     ///< "valve" (map) or "linear"
  std::string input_unit, output_unit;  ///< "A", "psi" or ""
  std::optional<StaticMap> map;
  TransferFunction dynamics;  ///< s or z domain; delay lives here
  double input_offset = 0;    ///< unit of the input
  double output_offset = 0;   ///< unit of the output
};

/// How a free run starts.
///
/// kSteady    steady state at the first input: what a recording that begins at rest needs
/// kMeasured  the first `samples` measured outputs set the state by least squares
struct InitialState {
  enum class Kind : std::uint8_t { kSteady, kMeasured } kind = Kind::kSteady;
  std::size_t samples = 0;
};

/// Free-run simulation: sees the input and the initial state, never a measured output on the way.
///
/// returns  one value per grid sample of the recording, unit of the output
/// Errors   `unstable` by name and modulus of the offending pole; a sample time that the model cannot be brought to
/// Cost     O(n · order)
Result<std::vector<double>> simulate(const Model& model, const Recording& recording, const InitialState& initial);

}  // namespace valvetriage
