// resonance: a lightly damped mode between valve and reading.
//
//   ÿ = ω² (y_in − y) − 2 ζ ω ẏ,   ω = 2π f,   exact for straight lines between samples, from steady state
//
// Source     fluid inertia in a line before a compliant gauge, a mounting that gives: Merritt, Hydraulic Control
// Systems
//            (1967), chapter 3; discretisation: Franklin, Powell, Workman, Digital Control (1998), ramp-invariant
// Looks like ringing of one frequency after every edge, a peak in the frequency response, none on holds
// Confused   with periodic_disturbance (goes on for ever), self_oscillation (at one level), extra_lag

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kFrequency, kDamping };

constexpr std::array<MechanismParameter, 2> kParameters{
    {{"frequency_hz", "Hz", "undamped frequency of the mode"}, {"damping_ratio", "", "of the mode, below 0.7"}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"periodic_disturbance", "self_oscillation", "extra_lag"};

MechanismBounds bounds(const MechanismScales& scales) {
  const double slowest_hz = 3 / scales.longest_s, fastest_hz = 2 / scales.sample_period_s;
  MechanismBounds bounds{.lower = {slowest_hz, 0.005},
                         .upper = {fastest_hz, 0.7},
                         .step = {1e-4 * std::sqrt(slowest_hz * fastest_hz), 1e-4},
                         .starts = {}};
  for (const double frequency : spread(8 * slowest_hz, 0.4 * fastest_hz, 12)) bounds.starts.push_back({frequency, 0.1});
  return bounds;
}

/// e^{AT} of A = ω [[0, 1], [−1, −2ζ]] on (y, ẏ/ω).
struct Transition {
  double yy, yv, vy, vv;
};
Transition transition(double angle, double damping) {
  const double decay = std::exp(-damping * angle);
  const double detuned = 1 - damping * damping;
  const double root = std::sqrt(std::abs(detuned));
  // cos and sin over root; cosh and sinh where the mode is overdamped, their common limit where it is critical
  double even = 1, odd = angle;
  if (root > 1e-8) {
    even = detuned > 0 ? std::cos(root * angle) : std::cosh(root * angle);
    odd = (detuned > 0 ? std::sin(root * angle) : std::sinh(root * angle)) / root;
  }
  return {decay * (even + damping * odd), decay * odd, -decay * odd, decay * (even - damping * odd)};
}

void filter(std::span<const double> parameters, const LawContext& context, std::span<double> signal) {
  if (!std::isfinite(parameters[kFrequency]) || signal.size() < 2) return;
  const double angle = 2 * std::numbers::pi * parameters[kFrequency] * (context.time_s[1] - context.time_s[0]);
  const double damping = parameters[kDamping];
  const Transition e = transition(angle, damping);
  double y = signal[0], v = 0, before = signal[0];
  for (double& value : signal.subspan(1)) {
    // The ramp itself, lagging by 2ζ/ω, and what rings about it.
    const double rate = (value - before) / angle;
    const double lag = 2 * damping * rate;
    const double from_ramp = y - (before - lag), rate_from_ramp = v - rate;
    y = value - lag + e.yy * from_ramp + e.yv * rate_from_ramp;
    v = rate + e.vy * from_ramp + e.vv * rate_from_ramp;
    before = value;
    value = y;
  }
}

void tangent(std::span<const double> parameters, const LawContext& context, std::span<const double>,
             std::span<double> change) {
  filter(parameters, context, change);
}

}  // namespace

extern constinit const Mechanism kResonance{
    .order = 11,
    .cause = "resonance",
    .family = "timing",
    .origin = "either",
    .wrong = "lightly damped mode",
    .law = "ÿ = ω² (y_in − y) − 2 ζ ω ẏ",
    .source = "Merritt, Hydraulic Control Systems (1967), chapter 3",
    .signature = "ringing of one frequency after every edge, dying out on holds; a peak in the frequency response",
    .confused_with = kConfusedWith,
    .place = Place::kOutput,
    .parameters = kParameters,
    .size_parameter = kFrequency,
    .neutral = std::numeric_limits<double>::infinity(),
    .bounds = bounds,
    .apply = filter,
    .tangent = tangent,
    .reshape = nullptr};

}  // namespace valvetriage
