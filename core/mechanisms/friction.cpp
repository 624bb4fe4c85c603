// friction: the spool sticks until the force difference passes breakaway, then slips.
//
//   in a valve, inside the spool's motion (core/model/spool_friction.h):
//   ẍ = ωn² (u − x − f) − 2 ζ ωn ẋ,  |f| ≤ F_s at rest,  f = sign(ẋ) (F_k + (F_s − F_k) e^(−(ẋ/v_s)²)) in motion
//   F_s, F_k times 1 + g (x − middle of the range): one force takes other currents where the magnet pulls otherwise
//   in a model without a spool, its stick-slip limit at the input:
//   held while |x − held| ≤ F_s;   else held ← x − sign(x − held) min(F_k, F_s)        forces as input equivalents
//
// Source        stick-slip limit of Coulomb friction with breakaway: Armstrong-Hélouvry, Dupont, Canudas de Wit,
//               Automatica 30 (1994) 1083; as a data-driven valve model: Choudhury, Thornhill, Shah, Control Eng.
//               Practice 13 (2005) 641
// Looks like    stair-steps on slow ramps, a level that depends on the side it was reached from; small inputs do
// nothing Confused with backlash (kinetic near breakaway is play), hysteresis (a smooth loop), dead_band (no memory)

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kBreakaway, kKinetic, kStribeck, kGrowth };

constexpr std::array<MechanismParameter, 4> kParameters{
    {{"breakaway_A", "A", "force that sets the resting spool in motion"},
     {"kinetic_A", "A", "force on the moving spool; at most breakaway"},
     {"stribeck_A_per_s", "A/s", "speed at which friction has fallen most of the way from breakaway to kinetic"},
     {"growth_per_A", "1/A", "of both forces along the input, relative to those in the middle of the range", 0, 0.3}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"backlash", "hysteresis", "dead_band"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double range = input_range(scales);
  const double slowest = 0.003 * range, fastest = 0.2 * range / scales.sample_period_s;
  const double growth = most_growth(range);
  MechanismBounds bounds{.lower = {0, 0, slowest, -growth},
                         .upper = {0.5 * range, 0.5 * range, fastest, growth},
                         .step = {1e-4 * range, 1e-4 * range, 1e-3 * range, 1e-3 * growth},
                         .starts = {}};
  for (const double breakaway : spread(0.005 * range, 0.08 * range, 4)) {
    for (const double kinetic : {0.65 * breakaway, 0.85 * breakaway}) {
      for (const double speed : {0.1 * range, 0.6 * range}) bounds.starts.push_back({breakaway, kinetic, speed, 0});
    }
    // Coulomb's, which is play where it is slow: what play explains this begins with.
    bounds.starts.push_back({breakaway, breakaway, 0.6 * range, 0});
  }
  return bounds;
}

void reshape(std::span<const double> parameters, ValveBlocks blocks) {
  blocks.friction.breakaway_a += parameters[kBreakaway];
  blocks.friction.kinetic_a += std::min(parameters[kKinetic], parameters[kBreakaway]);
  blocks.friction.stribeck_a_per_s = parameters[kStribeck];
  blocks.friction.growth.per_a = parameters[kGrowth];
}

/// A dry friction F holds the spool over 2 F.
void take_over(double width_a, std::span<double> parameters) {
  const double kinetic_share = parameters[kKinetic] / parameters[kBreakaway];
  parameters[kBreakaway] = 0.5 * width_a;
  parameters[kKinetic] = kinetic_share * parameters[kBreakaway];
}

/// The way of the driver that sticks is taken off the signal, so that noise on a held input does not move the spool and
/// a law without friction changes nothing.
void apply(std::span<const double> parameters, const LawContext& context, std::span<double> x) {
  const double breakaway = parameters[kBreakaway];
  const double kinetic = std::min(parameters[kKinetic], breakaway);
  const std::span<const double> driver = context.driver.empty() ? x : context.driver;
  const GrowthAlongInput growth{parameters[kGrowth], context.input_middle};
  double held = x.empty() ? 0 : driver[0];
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double pull = driver[i] - held, share = growth.share_at(held);
    if (std::abs(pull) > breakaway * share) held = driver[i] - std::copysign(kinetic * share, pull);
    x[i] -= driver[i] - held;
  }
}

constexpr MemoryWidth kMemoryWidth{
    .has_corners = true,
    .width_a = [](std::span<const double> parameters) { return 2 * parameters[kBreakaway]; },
    .take_over = take_over,
    .smooth_at_most = kKinetic};

}  // namespace

extern constinit const Mechanism kFriction{
    .order = 1,
    .cause = "friction",
    .family = "memory",
    .origin = "valve",
    .wrong = "sticks until the force difference passes breakaway, then slips (stiction, Coulomb)",
    .law =
        "|f| ≤ F_s at rest, f = sign(ẋ) (F_k + (F_s − F_k) exp(−(ẋ/v_s)²)) in motion; F_s, F_k times 1 + g (x − "
        "middle)",
    .source =
        "Armstrong-Hélouvry, Dupont, Canudas de Wit, Automatica 30 (1994) 1083; Choudhury, Thornhill, Shah, "
        "Control Eng. Practice 13 (2005) 641",
    .signature =
        "stair-steps on slow ramps; the level depends on the side it was reached from; small inputs do nothing",
    .confused_with = kConfusedWith,
    .place = Place::kInput,
    .parameters = kParameters,
    .size_parameter = kBreakaway,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = nullptr,
    .reshape = reshape,
    .is_in_blocks = [](std::span<const double>) { return true; },
    .memory = &kMemoryWidth};

}  // namespace valvetriage
