// side_input: a measured side channel acts on the output.
//
//   y ← y + k (s − s₀)
//
// s₀ is fitted as well, between the least and the largest value of the session: recordings are taken at one temperature
// each as often as the temperature changes in one.
//
// `channel` is the index of the side channel; a Model stores its name (MechanismUse::channel).
//
// Source     disturbance feedthrough, first order: ISO 10770-1 (temperature and supply sensitivity of a valve)
// Looks like a residual that follows a channel, at every level
// Confused   with sensor_drift (where the channel drifts), thermal_drift, sensor_offset

#include <algorithm>
#include <array>
#include <cmath>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kCoefficient, kReference, kChannel };

constexpr std::array<MechanismParameter, 3> kParameters{
    {{"coefficient", "psi per unit of the channel", "effect of the channel on the reading"},
     {"reference", "unit of the channel", "where the channel has no effect", 0},
     {"channel", "", "index of the side channel, from 0", 0}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"sensor_drift", "thermal_drift", "sensor_offset"};

MechanismBounds bounds(const MechanismScales& scales) {
  MechanismBounds bounds{.lower = {0, 0, 0}, .upper = {0, 0, 0}, .step = {0, 0, 0}, .starts = {}};
  for (std::size_t c = 0; c < scales.side.size(); ++c) {
    const auto [least, largest, mean] = scales.side[c];
    if (!(largest > least)) continue;
    const double most = scales.output_range / (largest - least);
    const bool is_first = bounds.starts.empty();
    bounds.upper = {std::max(bounds.upper[kCoefficient], most),
                    is_first ? largest : std::max(bounds.upper[kReference], largest), static_cast<double>(c)};
    bounds.lower[kReference] = is_first ? least : std::min(bounds.lower[kReference], least);
    bounds.lower[kCoefficient] = -bounds.upper[kCoefficient];
    bounds.step[kCoefficient] = 1e-5 * bounds.upper[kCoefficient];
    bounds.step[kReference] = std::max(bounds.step[kReference], 1e-4 * (largest - least));
    bounds.starts.push_back({0.01 * most, mean, static_cast<double>(c)});
  }
  return bounds;
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  const auto channel = static_cast<std::size_t>(std::max(std::llround(parameters[kChannel]), 0LL));
  if (parameters[kCoefficient] == 0 || channel >= context.side.size() || y.empty()) return;
  const std::vector<double>& s = context.side[channel].values;
  const std::size_t samples = std::min(s.size(), y.size());
  for (std::size_t i = 0; i < samples; ++i) y[i] += parameters[kCoefficient] * (s[i] - parameters[kReference]);
}

}  // namespace

extern constinit const Mechanism kSideInput{.order = 23,
                                            .cause = "side_input",
                                            .family = "slow",
                                            .origin = "stand",
                                            .wrong = "a measured side channel acts on the output",
                                            .law = "y ← y + k (s − s₀)",
                                            .source = "temperature and supply sensitivity of a valve: ISO 10770-1",
                                            .signature = "a residual that follows a side channel, at every level",
                                            .confused_with = kConfusedWith,
                                            .place = Place::kReading,
                                            .parameters = kParameters,
                                            .size_parameter = kCoefficient,
                                            .neutral = 0,
                                            .bounds = bounds,
                                            .apply = apply,
                                            .tangent = nullptr,
                                            .reshape = nullptr};

}  // namespace valvetriage
