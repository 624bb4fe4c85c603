// self_oscillation: hunting; a limit cycle that lives around one level, its frequency following the level.
//
//   y ← y + A r cos φ,   dr/dt = g r (D − r²),   D = max(1 − ((y − L) / w)², −1),   dφ/dt = 2π f (1 + s (y − L) / R)
//
// The normal form of a Hopf bifurcation: inside L ± w the cycle grows to √D at the rate g, outside it dies out. While
// it is dead (r = 1/1000) its phase waits at `phase_rad`, so the phase counts from the instant at which the level is
// entered, not from the start of the recording. Linear in (A cos phase, A sin phase): the columns of both are the law
// at A = 1, once with phase 0 and once with phase −π/2.
//
// Source     Guckenheimer and Holmes, Nonlinear Oscillations (1983), section 3.4; instability of pressure valves:
//            Merritt, Hydraulic Control Systems (1967), chapter 9
// Looks like a tone on holds near one level, none elsewhere, that takes time to grow
// Confused   with periodic_disturbance (at every level), resonance (dies out on holds)

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kFrequency, kAmplitude, kLevel, kWidth, kFrequencySlope, kGrowth, kPhase };

constexpr std::array<MechanismParameter, 7> kParameters{
    {{"frequency_hz", "Hz", "at the level where strongest"},
     {"amplitude_psi", "psi", "at the level where strongest"},
     {"strongest_at_psi", "psi", "that level"},
     {"half_width_psi", "psi", "it dies out this far from the level"},
     {"frequency_slope", "", "relative change of frequency over the output's range", 0},
     {"growth_per_s", "1/s", "rate at which a small cycle grows at the level"},
     {"phase_rad", "rad", "at the instant the level is entered", 0}}};
constexpr std::array<std::string_view, 2> kConfusedWith{"periodic_disturbance", "resonance"};
constexpr double kDead = 1e-3;  // a cycle of one thousandth shows in no recording

MechanismBounds bounds(const MechanismScales& scales) {
  const double range = scales.output_range, slowest_hz = 3 / scales.longest_s;
  const double fastest_hz = 0.45 / scales.sample_period_s;
  MechanismBounds bounds{
      .lower = {slowest_hz, 0, scales.output_low, 0.03 * range, -1, 3 / scales.longest_s, -std::numbers::pi},
      .upper = {fastest_hz, range, scales.output_high, range, 1, fastest_hz, std::numbers::pi},
      .step = {1e-4 * slowest_hz, 1e-4 * range, 1e-3 * range, 1e-3 * range, 1e-3, 1e-2, 1e-3},
      .starts = {}};
  if (!(range > 0)) return bounds;
  for (const double frequency : spread(std::max(6 * slowest_hz, 1.0), 0.4 * fastest_hz, 3)) {
    for (const double at : {0.57, 0.78}) {
      bounds.starts.push_back(
          {frequency, 0.01 * range, scales.output_low + at * range, 0.3 * range, 0, frequency, 0.0});
    }
  }
  return bounds;
}

/// r after a time with D unchanged: r² is logistic.
double grown(double r, double drive, double growth_s) {
  const double square = r * r;
  if (std::abs(drive) < 1e-9) return r / std::sqrt(1 + 2 * growth_s * square);
  return std::sqrt(drive / (1 + (drive / square - 1) * std::exp(-2 * growth_s * drive)));
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  const double amplitude = parameters[kAmplitude];
  if (amplitude == 0 || y.size() < 2) return;
  const double period = context.time_s[1] - context.time_s[0];
  const double turn = 2 * std::numbers::pi * parameters[kFrequency] * period;
  const double slope = context.output_range > 0 ? parameters[kFrequencySlope] / context.output_range : 0;
  double r = kDead, phase = parameters[kPhase];
  for (double& value : y) {
    const double from = value - parameters[kLevel];
    const double far = from / parameters[kWidth];
    const double drive = std::max(1 - far * far, -1.0);
    value += amplitude * (r > kDead ? r * std::cos(phase) : 0);
    r = std::max(grown(r, drive, parameters[kGrowth] * period), kDead);
    if (r > kDead) {
      phase += turn * (1 + slope * from);
    } else {
      phase = parameters[kPhase];
    }
  }
}

}  // namespace

extern constinit const Mechanism kSelfOscillation{
    .order = 17,
    .cause = "self_oscillation",
    .family = "disturbance",
    .origin = "valve",
    .wrong = "hunting: a tone whose amplitude and frequency depend on the level",
    .law = "y ← y + A r cos φ,  dr/dt = g r (D − r²),  D = 1 − ((y − L) / w)²,  dφ/dt = 2π f (1 + s (y − L) / R)",
    .source =
        "Guckenheimer, Holmes, Nonlinear Oscillations (1983), section 3.4; Merritt, Hydraulic Control Systems "
        "(1967), chapter 9",
    .signature = "a tone on holds near one level that takes time to grow, none elsewhere",
    .confused_with = kConfusedWith,
    .place = Place::kOutput,
    .parameters = kParameters,
    .size_parameter = kAmplitude,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = nullptr,
    .reshape = nullptr};

}  // namespace valvetriage
