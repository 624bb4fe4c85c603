// leakage: a loss flow out of the volume by the orifice law.
//
//   dp/dt ← dp/dt − κ f φ(H) ψ(p) / ψ(H),   ψ(p) ≈ √p                                   core/model/orifice_volume.h
//
// f is the loss over the through-flow at the reference's highest level H.
//
// Source     internal leakage past worn lands: Merritt, Hydraulic Control Systems (1967), chapters 3 and 5
// Looks like lower levels, more so at high pressure, and faster settling
// Confused   with static_curve and gain_loss (timing unchanged), orifice_flow

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{
    {{"loss_fraction", "", "loss over through-flow at the reference's highest level, beyond a good valve's"}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"static_curve", "gain_loss", "orifice_flow"};

MechanismBounds bounds(const MechanismScales&) {
  return one_parameter(0, 2, 1e-4, {0.01, 0.06, 0.25});
}

void reshape(std::span<const double> parameters, ValveBlocks blocks) {
  blocks.volume.loss_fraction += parameters[0];
}

}  // namespace

extern constinit const Mechanism kLeakage{
    .order = 14,
    .cause = "leakage",
    .family = "flow",
    .origin = "valve",
    .wrong = "loss flow by the orifice law: settles lower, faster, more so at high pressure",
    .law = "dp/dt ← dp/dt − κ f φ(H) √(p / H)",
    .source = "Merritt, Hydraulic Control Systems (1967), chapters 3 and 5",
    .signature = "lower levels, more so at high pressure, and faster settling",
    .confused_with = kConfusedWith,
    .place = Place::kPhysics,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 0,
    .bounds = bounds,
    .apply = nullptr,
    .tangent = nullptr,
    .reshape = reshape};

}  // namespace valvetriage
