// asymmetric_response: rising and falling time constants differ.
//
//   dp/dt ← (dp/dt) / ratio while p falls                                               core/model/orifice_volume.h
//
// and the same of a mode behind the map, where the valve has one                          core/model/sampled_mode.h
//
// Source     check valve or damping orifice that works one way: Merritt, Hydraulic Control Systems (1967), chapter 9
// Looks like falling edges slower (or quicker) than rising ones by the same factor at every level; levels unchanged
// Confused   with extra_lag (both ways), leakage and orifice_flow (levels move as well), rate_limit
//
// The ratio is that of the valve over a good one's, whose own rising and falling differ by the orifice law already.

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{
    {{"fall_to_rise_ratio", "", "falling over rising time constant, over a good valve's"}}};
constexpr std::array<std::string_view, 4> kConfusedWith{"extra_lag", "leakage", "orifice_flow", "rate_limit"};

MechanismBounds bounds(const MechanismScales&) {
  return one_parameter(0.1, 20, 1e-3, {1.15, 2, 0.7});
}

void reshape(std::span<const double> parameters, ValveBlocks blocks) {
  blocks.volume.fall_to_rise_ratio *= parameters[0];
}

}  // namespace

extern constinit const Mechanism kAsymmetricResponse{
    .order = 13,
    .cause = "asymmetric_response",
    .family = "timing",
    .origin = "valve",
    .wrong = "rising and falling time constants differ",
    .law = "dp/dt ← (dp/dt) / ratio while p falls",
    .source = "Merritt, Hydraulic Control Systems (1967), chapter 9",
    .signature = "falling edges slower or quicker than rising ones by one factor at every level; levels unchanged",
    .confused_with = kConfusedWith,
    .place = Place::kPhysics,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 1,
    .bounds = bounds,
    .apply = nullptr,
    .tangent = nullptr,
    .reshape = reshape};

}  // namespace valvetriage
