// rectified_sensor: the sensor tells the magnitude only.
//
//   y ← |y|
//
// Source     envelope detectors, unsigned converters and encoders without direction: Pallàs-Areny and Webster, Sensors
//            and Signal Conditioning (2001)
// Looks like a bipolar output folded at zero: twice the frequency, sharp minima at zero
// Confused   with saturation from below (a flat instead of a fold)

#include <array>
#include <cmath>
#include <limits>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<std::string_view, 1> kConfusedWith{"saturation"};

/// One start without parameters, where the output changes its sign at all.
MechanismBounds bounds(const MechanismScales& scales) {
  MechanismBounds bounds;
  if (scales.output_low < 0 && scales.output_high > 0) bounds.starts.emplace_back();
  return bounds;
}

void apply(std::span<const double>, const LawContext&, std::span<double> y) {
  for (double& value : y) value = std::abs(value);
}

void tangent(std::span<const double>, const LawContext&, std::span<const double> before, std::span<double> change) {
  for (std::size_t i = 0; i < change.size(); ++i) {
    if (before[i] < 0) change[i] = -change[i];
  }
}

}  // namespace

extern constinit const Mechanism kRectifiedSensor{
    .order = 8,
    .cause = "rectified_sensor",
    .family = "static",
    .origin = "stand",
    .wrong = "magnitude only",
    .law = "y ← |y|",
    .source = "Pallàs-Areny, Webster, Sensors and Signal Conditioning (2001)",
    .signature = "a bipolar output folded at zero: twice the frequency, sharp minima at zero",
    .confused_with = kConfusedWith,
    .place = Place::kOutput,
    .parameters = {},
    .size_parameter = 0,
    .neutral = std::numeric_limits<double>::quiet_NaN(),
    .bounds = bounds,
    .apply = apply,
    .tangent = tangent,
    .reshape = nullptr};

}  // namespace valvetriage
