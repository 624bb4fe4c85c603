// sensor_drift: the reading drifts linearly in time.
//
//   y ← y + d t,   t from the start of the recording
//
// Source     zero drift of strain gauges and amplifiers: Pallàs-Areny and Webster, Sensors and Signal Conditioning
// (2001) Looks like an error that grows evenly from the start of each recording, whatever the level Confused   with
// thermal_drift (in proportion to the level, settles), side_input (follows a channel), sensor_offset

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{{{"drift_psi_per_s", "psi/s", "of the reading"}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"thermal_drift", "side_input", "sensor_offset"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double steepest = scales.output_range / scales.longest_s;
  return one_parameter(-steepest, steepest, 1e-5 * steepest, both_signs({0.01 * steepest}));
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  for (std::size_t i = 0; i < y.size(); ++i) y[i] += parameters[0] * context.time_s[i];
}

}  // namespace

extern constinit const Mechanism kSensorDrift{
    .order = 21,
    .cause = "sensor_drift",
    .family = "slow",
    .origin = "stand",
    .wrong = "linear drift",
    .law = "y ← y + d t",
    .source = "Pallàs-Areny, Webster, Sensors and Signal Conditioning (2001)",
    .signature = "an error that grows evenly from the start of each recording, whatever the level",
    .confused_with = kConfusedWith,
    .place = Place::kOutput,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = nullptr,
    .reshape = nullptr};

}  // namespace valvetriage
