// rate_limit: the valve cannot move faster than a limit.
//
//   |dx/dt| ≤ limit, x follows its input otherwise
//
// Source     flow- or voltage-limited actuators: Rundqwist, Rate Limiters with Phase Compensation, ICAS (1996); slew of
// a
//            current driver
// Looks like straight edges after large steps, none after small ones; large fast sweeps become triangles
// Confused   with extra_lag (shape independent of size), transport_delay, asymmetric_response

#include <algorithm>
#include <array>
#include <limits>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

// A limit shares the time of a motion with the lags around it, and which of them it replaces is not known: a driver's
// slew ahead of the spool reads lower than it is by a third to a half.
constexpr double kUncertainty = 0.3;
constexpr std::array<MechanismParameter, 1> kParameters{{{.name = "limit_A_per_s",
                                                          .unit = "A/s",
                                                          .meaning = "fastest motion, as the input that would hold it",
                                                          .law_uncertainty = kUncertainty}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"extra_lag", "transport_delay", "asymmetric_response"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double range = input_range(scales);
  const double slowest = range / scales.longest_s, fastest = 2 * range / scales.sample_period_s;
  return one_parameter(slowest, fastest, 1e-3 * slowest, spread(5 * slowest, 0.1 * fastest, 5));
}

/// Follows x within the limit; tells for each sample whether the limit held it.
template <typename Use>
void follow(double limit, const LawContext& context, std::span<const double> x, Use use) {
  double at = x.empty() ? 0 : x[0];
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double way = i > 0 ? limit * (context.time_s[i] - context.time_s[i - 1]) : 0;
    const double asked = x[i] - at;
    const bool held = asked > way || asked < -way;
    at = held ? at + std::clamp(asked, -way, way) : x[i];
    use(i, at, held);
  }
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> x) {
  follow(parameters[0], context, x, [&](std::size_t i, double at, bool) { x[i] = at; });
}

void tangent(std::span<const double> parameters, const LawContext& context, std::span<const double> before,
             std::span<double> change) {
  double carried = change.empty() ? 0 : change[0];
  follow(parameters[0], context, before, [&](std::size_t i, double, bool held) {
    if (!held) carried = change[i];
    change[i] = carried;
  });
}

}  // namespace

extern constinit const Mechanism kRateLimit{
    .order = 12,
    .cause = "rate_limit",
    .family = "timing",
    .origin = "valve",
    .wrong = "cannot move faster than a limit",
    .law = "|dx/dt| ≤ limit",
    .source = "Rundqwist, Rate Limiters with Phase Compensation, ICAS (1996)",
    .signature = "straight edges after large steps, none after small ones; large fast sweeps become triangles",
    .confused_with = kConfusedWith,
    .place = Place::kPosition,
    .parameters = kParameters,
    .size_parameter = 0,
    .neutral = std::numeric_limits<double>::infinity(),
    .bounds = bounds,
    .apply = apply,
    .tangent = tangent,
    .reshape = nullptr};

}  // namespace valvetriage
