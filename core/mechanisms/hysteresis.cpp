// hysteresis: magnetic memory; a smooth, rate-independent loop between current and force.
//
//   x = u − (W/2) mean_k(E_k / r_k),   E_k ← clamp(E_k + Δu, −r_k, r_k)          core/model/magnetic_loop.h; W adds up
//
// Source     Kuhnen, Eur. J. Control 9 (2003) 407 (Prandtl-Ishlinskii); Bertotti, Hysteresis in Magnetism (1998)
// Looks like a lens between the way up and the way down, rounded at reversals, the same at every rate
// Confused   with backlash and friction (flat after a reversal), extra_lag (a lens that grows with the rate)

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{
    {{"width_A", "A", "full width of the major loop at mid range, beyond a good valve's own"}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"backlash", "friction", "extra_lag"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double range = input_range(scales);
  return one_parameter(0, 0.5 * range, 1e-4 * range, spread(0.004 * range, 0.1 * range, 3));
}

void reshape(std::span<const double> parameters, ValveBlocks blocks) {
  blocks.loop.width_a += parameters[0];
}

}  // namespace

extern constinit const Mechanism kHysteresis{
    .order = 3,
    .cause = "hysteresis",
    .family = "memory",
    .origin = "valve",
    .wrong = "magnetic memory: smooth, rate-independent loop",
    .law = "x = u − (W/2) mean(E_k / r_k),  E_k ← clamp(E_k + Δu, −r_k, r_k)",
    .source = "Kuhnen, Eur. J. Control 9 (2003) 407; Bertotti, Hysteresis in Magnetism (1998)",
    .signature = "a lens between the way up and the way down, rounded at reversals, the same at every rate",
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
