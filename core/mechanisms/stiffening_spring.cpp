// stiffening_spring: the restoring force has a cubic part.
//
//   z + c z³ = S (x − x0),   x ← x0 + z / S
//
// z is the travel in output units, S the map's secant over its whole range, x0 the input at which the spring is
// relaxed: the lowest input of a valve. At small travel nothing changes.
//
// Source     Duffing oscillator: Kovacic and Brennan, The Duffing Equation (2011); solved in closed form by sinh
// Looks like output that falls short ever more with travel; a resonance that rises with amplitude
// Confused   with static_curve (largest at mid range), saturation (a flat), gain_loss, leakage

#include <algorithm>
#include <array>
#include <cmath>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{
    {{"cubic_coefficient", "1/psi2", "c of the force k (z + c z³)"}}};
constexpr std::array<std::string_view, 4> kConfusedWith{"static_curve", "saturation", "gain_loss", "leakage"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double square = scales.output_range * scales.output_range;
  if (!(square > 0)) return {{0}, {0}, {0}, {}};
  return one_parameter(0, 3 / square, 1e-5 / square, {0.02 / square, 0.15 / square, 0.6 / square});
}

/// The travel under a force. A softening spring (c < 0) gives way at its largest force and stays there.
double travel(double force, double c) {
  if (c == 0) return force;
  const double size = std::sqrt(3 * std::abs(c));
  const double sine = 1.5 * size * force;
  if (c > 0) return 2 / size * std::sinh(std::asinh(sine) / 3);
  return 2 / size * std::sin(std::asin(std::clamp(sine, -1.0, 1.0)) / 3);
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> x) {
  if (parameters[0] == 0 || context.secant == 0) return;
  for (double& value : x) {
    const double z = travel(context.secant * (value - context.rest_input), parameters[0]);
    value = context.rest_input + z / context.secant;
  }
}

/// dz/df = 1 / (1 + 3 c z²)
void tangent(std::span<const double> parameters, const LawContext& context, std::span<const double> before,
             std::span<double> change) {
  if (parameters[0] == 0 || context.secant == 0) return;
  for (std::size_t i = 0; i < change.size(); ++i) {
    const double z = travel(context.secant * (before[i] - context.rest_input), parameters[0]);
    change[i] /= 1 + 3 * parameters[0] * z * z;
  }
}

}  // namespace

extern constinit const Mechanism kStiffeningSpring{
    .order = 16,
    .cause = "stiffening_spring",
    .family = "flow",
    .origin = "valve",
    .wrong = "restoring force with a cubic part",
    .law = "z + c z³ = S (x − x0),  x ← x0 + z / S",
    .source = "Kovacic, Brennan, The Duffing Equation (2011)",
    .signature = "the output falls short ever more with travel; small travel is untouched",
    .confused_with = kConfusedWith,
    .place = Place::kPosition,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = tangent,
    .reshape = nullptr};

}  // namespace valvetriage
