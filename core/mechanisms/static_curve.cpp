// static_curve: the static map has another shape.
//
//   y ← y + c R q (1 − q),   q = y / R,   |c| < 1 so that it stays monotone
//
// Source     linearity error of a characteristic, first term that vanishes at both ends: ISO 10770-1; a worn metering
// edge Looks like errors of one sign, largest at mid range, none at the ends; the same up and down, at every rate
// Confused   with leakage (largest at the top), gain_loss, stiffening_spring (largest at the top), orifice_flow

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{
    {{"curvature", "", "c; four times the deviation at mid range over R"}}};
constexpr std::array<std::string_view, 4> kConfusedWith{"leakage", "gain_loss", "stiffening_spring", "orifice_flow"};

MechanismBounds bounds(const MechanismScales&) {
  return one_parameter(-0.95, 0.95, 1e-4, both_signs({0.02, 0.15}));
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  if (!(context.output_range > 0)) return;
  for (double& value : y) {
    const double q = value / context.output_range;
    value += parameters[0] * value * (1 - q);  // R q = y
  }
}

void tangent(std::span<const double> parameters, const LawContext& context, std::span<const double> before,
             std::span<double> change) {
  if (!(context.output_range > 0)) return;
  for (std::size_t i = 0; i < change.size(); ++i) {
    change[i] *= 1 + parameters[0] * (1 - 2 * before[i] / context.output_range);
  }
}

}  // namespace

extern constinit const Mechanism kStaticCurve{
    .order = 7,
    .cause = "static_curve",
    .family = "static",
    .origin = "valve",
    .wrong = "the static map has another shape",
    .law = "y ← y + c R q (1 − q),  q = y / R",
    .source = "linearity error of a characteristic: ISO 10770-1",
    .signature = "errors of one sign, largest at mid range, none at the ends; the same up and down and at every rate",
    .confused_with = kConfusedWith,
    .place = Place::kSteady,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = tangent,
    .reshape = nullptr};

}  // namespace valvetriage
