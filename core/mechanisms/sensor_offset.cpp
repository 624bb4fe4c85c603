// sensor_offset: the reading is off by a constant.
//
//   y ← y + b
//
// Source     zero error of a gauge: ISO 5171
// Looks like the same error on every level, the level of rest included
// Confused   with gain_loss and static_curve (nothing at zero pressure), sensor_drift, side_input

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{{{"offset_psi", "psi", "reading less pressure"}}};
constexpr std::array<std::string_view, 4> kConfusedWith{"gain_loss", "static_curve", "sensor_drift", "side_input"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double range = scales.output_range;
  return one_parameter(-range, range, 1e-5 * range, both_signs({0.01 * range}));
}

void apply(std::span<const double> parameters, const LawContext&, std::span<double> y) {
  for (double& value : y) value += parameters[0];
}

}  // namespace

extern constinit const Mechanism kSensorOffset{.order = 20,
                                               .cause = "sensor_offset",
                                               .family = "slow",
                                               .origin = "stand",
                                               .wrong = "constant offset",
                                               .law = "y ← y + b",
                                               .source = "zero error of a gauge: ISO 5171",
                                               .signature = "the same error on every level, the level of rest included",
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
