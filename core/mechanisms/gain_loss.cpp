// gain_loss: the static gain is scaled, at every level alike.
//
//   y ← ratio · y
//
// Source     sensitivity error of a characteristic: ISO 10770-1; a weak magnet or spring, a shunted coil, a worn port
// Looks like every level off by the same share; timing unchanged
// Confused   with leakage (off by more at high pressure, and faster), static_curve (zero at both ends), thermal_drift
//            (grows in time), orifice_flow

#include <array>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{{{"ratio", "", "output over the baseline's output"}}};
constexpr std::array<std::string_view, 4> kConfusedWith{"leakage", "static_curve", "thermal_drift", "orifice_flow"};

MechanismBounds bounds(const MechanismScales&) {
  return one_parameter(0.1, 3, 1e-4, {0.98, 0.8, 1.05});
}

void apply(std::span<const double> parameters, const LawContext&, std::span<double> y) {
  for (double& value : y) value *= parameters[0];
}

void tangent(std::span<const double> parameters, const LawContext&, std::span<const double>, std::span<double> change) {
  for (double& value : change) value *= parameters[0];
}

}  // namespace

extern constinit const Mechanism kGainLoss{.order = 6,
                                           .cause = "gain_loss",
                                           .family = "static",
                                           .origin = "either",
                                           .wrong = "static gain scaled",
                                           .law = "y ← ratio · y",
                                           .source = "sensitivity error of a characteristic: ISO 10770-1",
                                           .signature = "every level is off by the same share; timing is unchanged",
                                           .confused_with = kConfusedWith,
                                           .place = Place::kSteady,
                                           .parameters = kParameters,
                                           .size_parameter = 0,
                                           .neutral = 1,
                                           .bounds = bounds,
                                           .apply = apply,
                                           .tangent = tangent,
                                           .reshape = nullptr};

}  // namespace valvetriage
