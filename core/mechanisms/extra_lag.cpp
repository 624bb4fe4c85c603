// extra_lag: one more, or a slower, first-order lag.
//
//   τ dy/dt = y_in − y,   exact for straight lines between samples, from steady state
//
// Source     a second chamber behind a restriction, a clogged gauge line: Merritt, Hydraulic Control Systems (1967),
//            chapter 3
// Looks like rounder and later edges, the same shape at every step size and level
// Confused   with transport_delay (no rounding), rate_limit (straight edges), asymmetric_response (one direction),
//            hysteresis in one slow triangle at one rate

#include <array>

#include "core/mechanisms/bounds.h"
#include "core/model/gauge.h"

namespace valvetriage {
namespace {

constexpr std::array<MechanismParameter, 1> kParameters{{{"time_constant_s", "s", "of the additional lag"}}};
constexpr std::array<std::string_view, 4> kConfusedWith{"transport_delay", "rate_limit", "asymmetric_response",
                                                        "hysteresis"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double period = scales.sample_period_s;
  return one_parameter(0, scales.longest_s, 0.02 * period, spread(0.5 * period, 0.05 * scales.longest_s, 4));
}

void filter(std::span<const double> parameters, const LawContext& context, std::span<double> signal) {
  if (signal.size() < 2) return;
  read_behind_lag(parameters[0], context.time_s[1] - context.time_s[0], signal);
}

void tangent(std::span<const double> parameters, const LawContext& context, std::span<const double>,
             std::span<double> change) {
  filter(parameters, context, change);
}

}  // namespace

extern constinit const Mechanism kExtraLag{
    .order = 10,
    .cause = "extra_lag",
    .family = "timing",
    .origin = "valve",
    .wrong = "one more, or a slower, first-order lag",
    .law = "τ dy/dt = y_in − y",
    .source = "Merritt, Hydraulic Control Systems (1967), chapter 3",
    .signature = "rounder and later edges, the same shape at every step size and level",
    .confused_with = kConfusedWith,
    .place = Place::kOutput,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = 0,
    .bounds = bounds,
    .apply = filter,
    .tangent = tangent,
    .reshape = nullptr};

}  // namespace valvetriage
