#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/model/machine.h"
#include "core/model/magnetic_loop.h"
#include "core/model/mode.h"
#include "core/model/orifice_volume.h"
#include "core/model/spool_friction.h"
#include "core/model/static_map.h"
#include "core/model/transfer_function.h"
#include "core/recording/intersample.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// A physical cause that a model was extended with: a law of core/mechanisms by its name, and its parameters.
struct MechanismUse {
  std::string cause;
  std::vector<double> parameters;  ///< in the order of the law's table
  /// `side_input`: the side channel that acts; `intermittent`: the recording it happened in, by name; else empty
  std::string channel;

  bool operator==(const MechanismUse&) const = default;
};

/// What `simulate` runs and an Analysis stores.
///
///   linear   y(t) = G (u − input_offset) + output_offset
///   valve    u → magnetic loop → G (delay and spool, static gain 1) → static map → volume → + output_offset
///            u → magnetic loop → static map → mode, delayed as G → volume → + output_offset
///
///   machine  the chain of blocks in `machine`, with offsets and laws of its own (G, map and offsets are not used)
///
/// The valve's blocks stand in the order of the physics: coil and magnet, spool, orifice, fluid volume. The map carries
/// the unit; loop and volume may be absent. Where the dynamics follow the map there is a mode, and G is a prompt spool:
/// it is run only where a law slows it, without its delay (mode.h). Linear models carry gain and delay in G.
struct Model {
  std::string kind;                     ///< "valve" (map), "linear" or "machine"
  std::string input_unit, output_unit;  ///< "A", "psi" or ""
  std::optional<MagneticLoop> loop;
  TransferFunction dynamics;  ///< s or z domain; delay lives here
  std::optional<StaticMap> map;
  std::optional<Mode> mode;
  std::optional<OrificeVolume> volume;
  std::optional<Machine> machine;         ///< kind "machine"
  std::optional<SpoolFriction> friction;  ///< of a valve's spool; made from `mechanisms`, never stored by itself
  double input_offset = 0;                ///< unit of the input
  InputBetween input_between = InputBetween::kStraight;  ///< of a valve or a linear system
  double output_offset = 0;                              ///< unit of the output
  std::vector<MechanismUse>
      mechanisms;  ///< in the order they were found; run by core/mechanisms, not by the linear core
};

/// How a free run starts.
///
/// kSteady    steady state at the first input: what a recording that begins at rest needs
/// kMeasured  the first `samples` measured outputs set the state by least squares
struct InitialState {
  enum class Kind : std::uint8_t { kSteady, kMeasured } kind = Kind::kSteady;
  std::size_t samples = 0;
};

/// Whether a model that is not stable may be run.
///
/// kUnbounded  a simulation must make sense however long the record is: unstable models are refused by name
/// kFinite     this record only; where the model has no equilibrium it starts from zero state
enum class Horizon : std::uint8_t { kUnbounded, kFinite };

/// Free-run simulation: sees the input and the initial state, never a measured output on the way.
///
/// A z-domain model is the recursion that was fitted, run on the samples as they stand; brought to another sample time
/// it goes through the continuous system of which it is the hold equivalent. An s-domain model is sampled exactly, its
/// delay to the fraction of a sample, with steps held and everything else linear between samples. Before the first
/// sample the input has been what it is there.
///
/// returns  one value per grid sample of the recording, unit of the output
/// Errors   `unstable` by name and modulus of the offending pole; `no_continuous_equivalent`, `fractional_delay` for a
///          sample time that the model cannot be brought to; `overflow` where a finite horizon was too long
/// Cost     O(n · order), nothing allocated per sample; a pure function. kMeasured runs the first samples once per
/// state
Result<std::vector<double>> simulate(const Model& model, const Recording& recording, const InitialState& initial,
                                     Horizon horizon = Horizon::kUnbounded);

/// The same on an input alone, sample_period_s > 0. `measured` (may be empty) are the outputs that kMeasured takes its
/// first samples from; NaN marks one that takes no part.
Result<std::vector<double>> simulate(const Model& model, const IntervalSignal& input, double sample_period_s,
                                     std::span<const double> measured, const InitialState& initial,
                                     Horizon horizon = Horizon::kUnbounded);

}  // namespace valvetriage
