#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "core/model/orifice_volume.h"
#include "core/model/spool_friction.h"
#include "core/model/valve_dynamics.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// Where in a model a law acts, from the input to the reading.
///
/// kInput     on the input between samples: every interval's start and end, one after the other
/// kPosition  behind the spool's dynamics, before the static map; input units
/// kSteady    behind the static map: the output that would be steady
/// kPhysics   inside the valve's own blocks: the law changes their parameters (`reshape`)
/// kOutput    behind the volume: the pressure and what the gauge makes of it
/// kReading   added to the reading, behind every law at kOutput whatever their order: nothing delays or limits it
///
/// In a linear model, which has no map and no volume, x = G (u − input_offset) / G(0) + input_offset is the position,
/// and kSteady acts where kOutput does, before it.
enum class Place : std::uint8_t { kInput, kPosition, kSteady, kPhysics, kOutput, kReading };

/// One physical parameter of a law.
struct MechanismParameter {
  std::string_view name;  ///< of the contract, with its unit where it has one: `breakaway_A`
  std::string_view unit;  ///< "A", "psi", "s", "Hz", "1/psi2", ... in valve units; "" where unitless
  std::string_view meaning;
  /// Value where a document does not give one; NaN: it must.
  double otherwise = std::numeric_limits<double>::quiet_NaN();
  /// Relative standard uncertainty of the value as a property of the machine, however well the law's own is known: what
  /// the law leaves out moves it (type B of the Guide to the Expression of Uncertainty in Measurement, JCGM 100:2008).
  double law_uncertainty = 0;
};

/// What the bounds of a parameter depend on: the recordings at hand.
struct MechanismScales {
  double sample_period_s = 0;  ///< shortest
  double longest_s = 0;        ///< longest recording
  double input_low = 0, input_high = 0;
  double output_low = 0, output_high = 0;    ///< of the simulation without the law
  double reading_low = 0, reading_high = 0;  ///< where the lowest and highest readings stay; both 0: not known
  double output_range = 0;                   ///< R: the reference's range, else output_high − output_low
  double slope = 0;                          ///< steepest output per input of the model, for sizes in output units
  std::size_t recordings = 1;                ///< of the session
  struct Side {
    double least = 0, largest = 0, mean = 0;
  };
  std::vector<Side> side;  ///< values of each side channel over the session
};

/// A point of the parameters with its bounds, all of the same length as the law's parameters.
struct MechanismBounds {
  std::vector<double> lower, upper;
  std::vector<double> step;                 ///< for differences; 0: a whole number, to be searched and not varied
  std::vector<std::vector<double>> starts;  ///< where a search begins, none of them without effect; empty: nothing here
                                            ///< that the law could act on
};

/// What a law on a signal may look at, beside the signal. `time_s` has one entry per entry of the signal (kInput: two
/// per sample, its start and its end), counted from the start of the recording.
struct LawContext {
  std::span<const double> time_s;
  double output_range = 0;         ///< R
  std::span<const double> steady;  ///< kOutput and kSteady: the output that would be steady, empty if unknown
  std::span<const double> driver;  ///< kInput: the signal without its noise, edges kept; empty: the signal itself
  std::span<const Channel> side;   ///< side channels on the same samples (kReading only)
  std::size_t recording = 0;       ///< index of the recording in the session
  std::span<const double> input;   ///< kSteady: the input at each sample; empty if unknown
  double input_middle = 0;         ///< kSteady: middle of the input's range, ends of the map
  double rest_input = 0;           ///< kPosition: where a restoring spring is relaxed (valve: the lowest input)
  double secant = 0;               ///< kPosition: output per input over the whole range, ends of the map
  /// kOutput: the reading itself, and the rms of its noise. Empty in a free run. A law may follow in it the phase of
  /// what no input foretells, and of every sample it may look at others only.
  std::span<const double> measured;
  double noise_rms = 0;
};

/// The valve's blocks, whose parameters a kPhysics law changes.
struct ValveBlocks {
  ValveDynamics& spool;
  OrificeVolume& volume;
  SpoolFriction& friction;
};

/// Over how much of the input a law of memory holds the output: one such law, or a valve's own loops, can stand in the
/// place of another.
struct MemoryWidth {
  bool has_corners;  ///< follows at once where it lets go, like a valve's narrow loop; otherwise rounded like the wide
  double (*width_a)(std::span<const double> parameters);            ///< [A]
  void (*take_over)(double width_a, std::span<double> parameters);  ///< gives them that width
  /// The parameter which at its largest makes the law as smooth as play, none where it has none: slips are gone.
  std::optional<std::size_t> smooth_at_most = std::nullopt;
};

/// One physical cause: its law, where it comes from, what it looks like, what it is confused with. One file each.
struct Mechanism {
  int order;                ///< place in the contract's table, from 1
  std::string_view cause;   ///< the contract's name, and the file's
  std::string_view family;  ///< memory static timing flow disturbance slow
  std::string_view origin;  ///< valve stand either
  std::string_view wrong;   ///< what is physically wrong
  std::string_view law;     ///< the equation
  std::string_view source;
  std::string_view signature;                       ///< what it looks like in a recording
  std::span<const std::string_view> confused_with;  ///< causes
  Place place;
  /// Those of the contract first, then what the law needs beside them (a phase, the index of a channel).
  std::span<const MechanismParameter> parameters;
  /// Entry of `parameters` that measures the size of the effect, and the value at which it has none (may be infinite).
  /// A law without parameters is on or off: `size_parameter` is then parameters.size().
  std::size_t size_parameter;
  double neutral;

  MechanismBounds (*bounds)(const MechanismScales&);

  /// The law on a signal, in place. Null for kPhysics.
  void (*apply)(std::span<const double> parameters, const LawContext& context, std::span<double> signal);
  /// How a small change before the law leaves it, in place; `before` is the signal that entered. Null: unchanged
  /// (an additive law), or kInput, kPosition and kPhysics.
  void (*tangent)(std::span<const double> parameters, const LawContext& context, std::span<const double> before,
                  std::span<double> change);
  /// The law on the valve's blocks. A law of another place has it too where a block of the valve must know of it; a
  /// model without that block does with `apply` alone. Null otherwise.
  void (*reshape)(std::span<const double> parameters, ValveBlocks blocks);

  /// How many of the last parameters every recording has its own of: the phase of a tone that does not stop between.
  std::size_t own_per_recording = 0;
  /// Whether with these parameters `reshape` alone acts in a valve; `apply` is then for models without its blocks.
  /// Null: never.
  bool (*is_in_blocks)(std::span<const double> parameters) = nullptr;

  /// Whether with these parameters the effect lies where the recordings do not show the whole of it: its bounds are
  /// those of the recordings. Null: never.
  bool (*is_cut_off)(std::span<const double> parameters, std::span<const double> lower,
                     std::span<const double> upper) = nullptr;

  /// Null: no law of memory.
  const MemoryWidth* memory = nullptr;

  /// What documents count the size parameter from, in a valve with this volume: an exponent is written as the valve's
  /// own and the law's excess together. Null: 0.
  double (*counted_from)(const OrificeVolume& volume) = nullptr;

  bool acts_in_blocks_alone(std::span<const double> at) const { return is_in_blocks && is_in_blocks(at); }
  double written_from(const std::optional<OrificeVolume>& volume) const {
    return counted_from && volume ? counted_from(*volume) : 0;
  }
  /// The nearest parameters that a document with this volume gives back to the last bit.
  std::vector<double> as_written(std::vector<double> values, const std::optional<OrificeVolume>& volume) const {
    const double from = written_from(volume);
    if (size_parameter < values.size() && from != 0) values[size_parameter] = (from + values[size_parameter]) - from;
    return values;
  }
};

/// Every mechanism there is, in the order of the contract's table. The list is made by CMake from the files of this
/// folder: <cause>.cpp defines `k<Cause>`.
std::span<const Mechanism* const> all_mechanisms();

/// Null for a name that is none of them.
const Mechanism* find_mechanism(std::string_view cause);

}  // namespace valvetriage
