// thermal_drift: the gain falls as the coil warms with its own losses.
//
//   y ← y (1 + g θ),   τ dθ/dt = 1 − k + k (u / u_mid)² − θ,   θ = 0 at the start of the recording
//
// k is the share of copper losses among what heats, u_mid the middle of the input's range. Where the input is not
// known, k = 0: θ = 1 − e^(−t/τ).
//
// Source     one-body model of a coil with copper losses: Incropera and DeWitt, Fundamentals of Heat and Mass Transfer,
//            section 5.1 (lumped capacitance)
// Looks like all levels sinking by the same share from the start of each recording on, settling after a few τ
// Confused   with gain_loss (from the first sample on), sensor_drift (same at every level, does not settle),
//            intermittent (abrupt)

#include <algorithm>
#include <array>
#include <cmath>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kChange, kTimeConstant, kCopperShare };

constexpr std::array<MechanismParameter, 3> kParameters{
    {{"gain_change", "", "at the end of warming, at mid input"},
     {"time_constant_s", "s", "of warming"},
     {"copper_share", "", "share of the heating that goes with the square of the input", 0}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"gain_loss", "sensor_drift", "intermittent"};
// Copper of a tenth of a millimetre in still air warms in two seconds (ρ c d / 4 h: 3.4 MJ/m³K, 50 W/m²K), every
// winding slower. What is there sooner was there when the recording began.
constexpr double kFastest_s = 1;

/// Warming lowers a coil's gain. One that rises from the start of each recording on is another effect's: creep under
/// load looks like that.
MechanismBounds bounds(const MechanismScales& scales) {
  const double longest = scales.longest_s;
  const double slowest = 3 * longest;
  MechanismBounds bounds{.lower = {-0.9, std::min(kFastest_s, slowest), 0},
                         .upper = {0, slowest, 1},
                         .step = {1e-4, 1e-3 * longest, 1e-2},
                         .starts = {}};
  for (const double change : {-0.02, -0.15}) {
    for (const double share : {0.1, 0.4})
      bounds.starts.push_back({change, std::max(bounds.lower[1], share * longest), 0.5});
  }
  return bounds;
}

/// Gain at each sample, the heating held over a sample.
template <typename Use>
void warm(std::span<const double> parameters, const LawContext& context, std::size_t samples, Use use) {
  if (parameters[kChange] == 0 || samples < 2) return;
  const double period = context.time_s[1] - context.time_s[0];
  const double middle = context.input_middle;
  const bool known = context.input.size() >= samples && middle != 0;
  const double copper = known ? parameters[kCopperShare] : 0;
  const double share = -std::expm1(-period / parameters[kTimeConstant]);
  double theta = 0;
  for (std::size_t i = 0; i < samples; ++i) {
    use(i, 1 + parameters[kChange] * theta);
    const double over = known ? context.input[i] / middle : 1;
    theta += share * (1 - copper + copper * over * over - theta);
  }
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  warm(parameters, context, y.size(), [&](std::size_t i, double gain) { y[i] *= gain; });
}

void tangent(std::span<const double> parameters, const LawContext& context, std::span<const double>,
             std::span<double> change) {
  warm(parameters, context, change.size(), [&](std::size_t i, double gain) { change[i] *= gain; });
}

}  // namespace

extern constinit const Mechanism kThermalDrift{
    .order = 19,
    .cause = "thermal_drift",
    .family = "slow",
    .origin = "valve",
    .wrong = "gain falls as the coil warms",
    .law = "y ← y (1 + g θ),  τ dθ/dt = 1 − k + k (u / u_mid)² − θ",
    .source = "Incropera, DeWitt, Fundamentals of Heat and Mass Transfer, section 5.1",
    .signature = "all levels sink by the same share from the start of each recording on, and settle",
    .confused_with = kConfusedWith,
    .place = Place::kSteady,
    .parameters = kParameters,
    .size_parameter = kChange,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = tangent,
    .reshape = nullptr};

}  // namespace valvetriage
