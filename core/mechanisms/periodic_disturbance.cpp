// periodic_disturbance: an additive tone that does not depend on the input.
//
//   y ← y + A sin(2π f t + phase),   t from the start of the recording
//
// Its phase goes on inside a recording and means nothing between recordings: whoever fits several estimates sine and
// cosine amplitude of each (the law is linear in A cos phase and A sin phase: the columns are the law at A = 1 with
// phase 0 and π/2) and gives one of the phases to the model. Above a fifth of the sampling rate the tone may be an
// alias.
//
// Source     pump ripple, mains hum: Merritt, Hydraulic Control Systems (1967), chapter 4; line estimation: Rife and
//            Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591
// Looks like one line in the spectrum of the residual on holds, ramps and sweeps alike
// Confused   with self_oscillation (at one level), resonance (dies out on holds)

#include <array>
#include <cmath>
#include <numbers>

#include "core/mechanisms/bounds.h"

namespace valvetriage {
namespace {

enum Parameter { kFrequency, kAmplitude, kPhase };

constexpr std::array<MechanismParameter, 3> kParameters{
    {{"frequency_hz", "Hz", "of the tone as recorded"},
     {"amplitude_psi", "psi", "half of peak to peak"},
     {"phase_rad", "rad", "of the sine at the start of the recording", 0}}};
constexpr std::array<std::string_view, 2> kConfusedWith{"self_oscillation", "resonance"};

/// From ten periods in the longest recording, fewer do not tell a tone from what wanders slowly, to the Nyquist
/// frequency.
MechanismBounds bounds(const MechanismScales& scales) {
  constexpr double kFewestPeriods = 10;
  const double slowest_hz = kFewestPeriods / scales.longest_s, fastest_hz = 0.495 / scales.sample_period_s;
  const double range = scales.output_range;
  MechanismBounds bounds{.lower = {slowest_hz, 0, -std::numbers::pi},
                         .upper = {fastest_hz, range, std::numbers::pi},
                         .step = {1e-3 * slowest_hz, 1e-5 * range, 1e-3},
                         .starts = {}};
  for (const double frequency : spread(2 * slowest_hz, 0.5 * fastest_hz, 6)) {
    bounds.starts.push_back({frequency, 0.005 * range, 0});
  }
  return bounds;
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  if (parameters[kAmplitude] == 0) return;
  const double rad_s = 2 * std::numbers::pi * parameters[kFrequency];
  for (std::size_t i = 0; i < y.size(); ++i) {
    y[i] += parameters[kAmplitude] * std::sin(rad_s * context.time_s[i] + parameters[kPhase]);
  }
}

}  // namespace

extern constinit const Mechanism kPeriodicDisturbance{
    .order = 18,
    .cause = "periodic_disturbance",
    .family = "disturbance",
    .origin = "stand",
    .wrong = "additive tone independent of the input (pump ripple, mains)",
    .law = "y ← y + A sin(2π f t + phase)",
    .source =
        "Merritt, Hydraulic Control Systems (1967), chapter 4; Rife, Boorstyn, IEEE Trans. Inf. Theory 20 (1974) 591",
    .signature = "one line in the residual's spectrum, on holds, ramps and sweeps alike",
    .confused_with = kConfusedWith,
    .place = Place::kOutput,
    .parameters = kParameters,
    .size_parameter = kAmplitude,
    .neutral = 0,
    .bounds = bounds,
    .apply = apply,
    .tangent = nullptr,
    .reshape = nullptr,
    .own_per_recording = 1};

}  // namespace valvetriage
