// orifice_flow: the outflow follows another power of the pressure drop, so that gain and time constant depend on level.
//
//   φ_n(p) ← φ_{n+Δ}(p) φ_n(r) / φ_{n+Δ}(r)   out of the volume; the inflow is a good valve's
//
// The flow at the reference pressure r is unchanged; below it, with Δ < 0, more leaves and the level is lower, above it
// less leaves and the level is higher. What is fitted is the excess Δ; the exponent that documents give is n + Δ.
//
// Source     orifices between laminar and turbulent: Merritt, Hydraulic Control Systems (1967), chapter 3; Borutzky,
//            Control Eng. Practice 10 (2002) 1253
// Looks like levels too low below mid pressure and too high above (or the other way), settling times that follow
// Confused   with static_curve (timing unchanged), leakage (all levels lower), gain_loss

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

// One power stands for every orifice on the way out, a good valve's too.
constexpr double kUncertainty = 0.05;
constexpr std::array<MechanismParameter, 1> kParameters{{{.name = "exponent",
                                                          .unit = "",
                                                          .meaning = "of the outflow over the pressure drop",
                                                          .law_uncertainty = kUncertainty}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"static_curve", "leakage", "gain_loss"};

MechanismBounds bounds(const MechanismScales&) {
  return one_parameter(-0.5, 0.6, 1e-4, both_signs({0.005, 0.04}));
}

/// No orifice, laminar, turbulent or between, has a power as far from a good valve's: what the data ask for there is
/// another effect's.
bool is_cut_off(std::span<const double> parameters, std::span<const double> lower, std::span<const double> upper) {
  return parameters[0] <= lower[0] || parameters[0] >= upper[0];
}

void reshape(std::span<const double> parameters, ValveBlocks blocks) {
  blocks.volume.drain_excess_exponent += parameters[0];
}

double counted_from(const OrificeVolume& volume) {
  return volume.exponent;
}

}  // namespace

extern constinit const Mechanism kOrificeFlow{
    .order = 15,
    .cause = "orifice_flow",
    .family = "flow",
    .origin = "either",
    .wrong = "flow law of another power than a good valve's: gain and time constant depend on level",
    .law = "outflow φ_n(p) ← φ_{n+Δ}(p) φ_n(r) / φ_{n+Δ}(r)",
    .source = "Merritt, Hydraulic Control Systems (1967), chapter 3; Borutzky, Control Eng. Practice 10 (2002) 1253",
    .signature = "levels too low below mid pressure and too high above, or the other way; settling times follow",
    .confused_with = kConfusedWith,
    .place = Place::kPhysics,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 0,
    .bounds = bounds,
    .apply = nullptr,
    .tangent = nullptr,
    .reshape = reshape,
    .is_cut_off = is_cut_off,
    .counted_from = counted_from};

}  // namespace valvetriage
