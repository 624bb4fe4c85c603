// backlash: lost motion; the output holds while the input reverses through the play.
//
//   z ← min(max(z, x − w/2), x + w/2),  w = W (1 + g (x − middle of the range))          the play operator
//   A play is a way of the spool: where the magnet pulls otherwise it takes other currents.
//
// Source     Krasnosel'skii and Pokrovskii, Systems with Hysteresis (1989);
//            Nordin and Gutman, Automatica 38 (2002) 1633
// Looks like a flat piece after every reversal, as wide at every rate; level differs by W up and down, no slip-jump
// Confused   with friction (slips in jumps), hysteresis (rounded, scales with the way), dead_band (no memory)

#include <algorithm>
#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kWidth, kGrowth, kMemory };

constexpr std::array<MechanismParameter, 3> kParameters{
    {{"width_A", "A", "full width of the play"},
     {"growth_per_A", "1/A", "of the width along the input, relative to that in the middle of the range", 0, 0.3},
     {"memory", "", "where in the play the recording begins, from -1 to 1; each recording has its own"}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"friction", "hysteresis", "dead_band"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double range = input_range(scales);
  const double growth = most_growth(range);
  MechanismBounds bounds{.lower = {0, -growth, -1},
                         .upper = {0.5 * range, growth, 1},
                         .step = {2e-4 * range, 1e-3 * growth, 0.05},
                         .starts = {}};
  for (const double width : spread(0.004 * range, 0.1 * range, 3)) bounds.starts.push_back({width, 0, 0});
  return bounds;
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> x) {
  if (x.empty()) return;
  const GrowthAlongInput growth{parameters[kGrowth], context.input_middle};
  const auto half_at = [&](double at) { return 0.5 * parameters[kWidth] * growth.share_at(at); };
  const std::span<const double> driver = context.driver.empty() ? x : context.driver;
  double z = driver[0] + (parameters.size() > kMemory ? parameters[kMemory] * half_at(driver[0]) : 0);
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double at = driver[i], half = half_at(at);
    z = std::clamp(z, at - half, at + half);
    x[i] -= at - z;
  }
}

constexpr MemoryWidth kMemoryWidth{
    .has_corners = true,
    .width_a = [](std::span<const double> parameters) { return parameters[kWidth]; },
    .take_over = [](double width_a, std::span<double> parameters) { parameters[kWidth] = width_a; }};

}  // namespace

extern constinit const Mechanism kBacklash{
    .order = 2,
    .cause = "backlash",
    .family = "memory",
    .origin = "valve",
    .wrong = "lost motion: output holds while the input reverses through the play",
    .law = "z ← min(max(z, x − w/2), x + w/2), w = W (1 + g (x − middle))",
    .source = "Krasnosel'skii, Pokrovskii, Systems with Hysteresis (1989); Nordin, Gutman, Automatica 38 (2002) 1633",
    .signature =
        "a flat piece of the same width after every reversal, at every rate; then the input is followed without "
        "a jump",
    .confused_with = kConfusedWith,
    .place = Place::kPosition,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = nullptr,
    .reshape = nullptr,
    .own_per_recording = 1,
    .memory = &kMemoryWidth};

}  // namespace valvetriage
