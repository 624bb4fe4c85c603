// saturation: the output stops at a level.
//
//   y ← clamp(y, lower, level), its corner rounded over ± R/1000
//
// In the valve it is a relief, and the volume itself stops there (`reshape`), so that it leaves the level at once when
// less is asked for; or the spool comes to a stop, and the volume settles at the level as slowly as at any other. Where
// there is no volume the reading is clamped.
//
// Source     relief valve: Merritt, Hydraulic Control Systems (1967), chapter 9; clipping of a reading is the same law
// Looks like equal outputs at all higher inputs, on several visits; nothing below the level is touched
// Confused   with static_curve and gain_loss (no flat), dead_band (a flat in the middle)

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kLevel, kLowerLevel, kSpoolStops };

constexpr std::array<MechanismParameter, 3> kParameters{
    {{"level_psi", "psi", "the output does not go above it"},
     {"lower_level_psi", "psi", "the output does not go below it; below every output, or minus infinity: there is none",
      -std::numeric_limits<double>::infinity()},
     {"spool_stops", "", "1: the spool comes to a stop; 0: a relief opens, or the reading is clipped", 0}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"static_curve", "gain_loss", "dead_band"};
constexpr double kKneeShare = 1e-3;  // of the output's range: a fifth of a psi, below the noise of any gauge

MechanismBounds bounds(const MechanismScales& scales) {
  const double low = scales.output_low, high = scales.output_high, range = high - low;
  const double none = low - 0.5 * range;
  MechanismBounds bounds{.lower = {low, none, 0},
                         .upper = {high + 0.05 * range, high, 1},
                         .step = {1e-4 * range, 1e-4 * range, 0},
                         .starts = {}};
  if (!(range > 0)) return bounds;
  for (const double stops : {0.0, 1.0}) {
    if (scales.reading_high > scales.reading_low) {
      bounds.starts.push_back(
          {std::clamp(scales.reading_high, bounds.lower[kLevel], bounds.upper[kLevel]), none, stops});
    }
    for (const double below : {0.01, 0.08, 0.3}) bounds.starts.push_back({high - below * range, none, stops});
  }
  for (const double inside : {0.03, 0.2}) bounds.starts.push_back({high - inside * range, low + inside * range, 0});
  return bounds;
}

bool spool_stops(std::span<const double> parameters) {
  return parameters[kSpoolStops] != 0;
}

/// y and dy/dx of a clamp from above, its corner a parabola from level − knee to level + knee.
struct Clamped {
  double value, slope;
};
Clamped below(double x, double level, double knee) {
  if (!(x > level - knee)) return {x, 1};
  if (x >= level + knee) return {level, 0};
  const double into = x - level + knee;
  return {x - into * into / (4 * knee), 1 - into / (2 * knee)};
}

Clamped between(double x, std::span<const double> parameters, double knee) {
  const Clamped top = below(x, parameters[kLevel], knee);
  const Clamped bottom = below(-top.value, -parameters[kLowerLevel], knee);
  return {-bottom.value, top.slope * bottom.slope};
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  for (double& value : y) value = between(value, parameters, kKneeShare * context.output_range).value;
}

void tangent(std::span<const double> parameters, const LawContext& context, std::span<const double> before,
             std::span<double> change) {
  for (std::size_t i = 0; i < change.size(); ++i) {
    change[i] *= between(before[i], parameters, kKneeShare * context.output_range).slope;
  }
}

void reshape(std::span<const double> parameters, ValveBlocks blocks) {
  double& level_psi = spool_stops(parameters) ? blocks.volume.stop_psi : blocks.volume.ceiling_psi;
  level_psi = std::min(level_psi, parameters[kLevel]);
}

}  // namespace

extern constinit const Mechanism kSaturation{
    .order = 5,
    .cause = "saturation",
    .family = "static",
    .origin = "either",
    .wrong = "output stops at a level",
    .law = "y ← clamp(y, lower level, level)",
    .source = "relief valve: Merritt, Hydraulic Control Systems (1967), chapter 9",
    .signature = "equal outputs at all inputs beyond one, on several visits; nothing changes before that level",
    .confused_with = kConfusedWith,
    .place = Place::kOutput,
    .parameters = kParameters,
    .size_parameter = kLevel,
    .neutral = std::numeric_limits<double>::infinity(),
    .bounds = bounds,
    .apply = apply,
    .tangent = tangent,
    .reshape = reshape,
    .is_in_blocks = spool_stops};

}  // namespace valvetriage
