// resonance: a lightly damped mode between valve and reading.
//
//   ÿ = ω² (y_in − y) − 2 ζ ω ẏ,   ω = 2π f,   exact for the parabola through the last three samples, from steady state
//
// Source     fluid inertia in a line before a compliant gauge, a mounting that gives: Merritt, Hydraulic Control
// Systems
//            (1967), chapter 3; discretisation: Franklin, Powell, Workman, Digital Control (1998), invariant to ramps
//            and parabolas: a pressure bends between its samples, and straight lines take an eighth of 40 Hz at 200 Hz
// Looks like ringing of one frequency after every edge, a peak in the frequency response, none on holds
// Confused   with periodic_disturbance (goes on for ever), self_oscillation (at one level), extra_lag

#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/mechanisms/bounds.h"
#include "core/model/mode.h"

namespace valvetriage {
namespace {

enum Parameter { kFrequency, kDamping };

// How hard an edge excites a mode is the doing of every lag ahead of it, known to a tenth at the mode's frequency; a
// ringing that is a tenth too weak at its start is made up for by a fifth less of damping.
constexpr double kFrequencyUncertainty = 0.01, kDampingUncertainty = 0.2;
constexpr std::array<MechanismParameter, 2> kParameters{{{.name = "frequency_hz",
                                                          .unit = "Hz",
                                                          .meaning = "undamped frequency of the mode",
                                                          .law_uncertainty = kFrequencyUncertainty},
                                                         {.name = "damping_ratio",
                                                          .unit = "",
                                                          .meaning = "of the mode, below 0.7",
                                                          .law_uncertainty = kDampingUncertainty}}};
constexpr std::array<std::string_view, 3> kConfusedWith{"periodic_disturbance", "self_oscillation", "extra_lag"};

// A parabola through three samples, two periods apart, follows no faster turn than this. Nearer to half the sampling
// rate a mode stands for whatever a simulation gets wrong within a sample of an edge, which good valves show as well.
constexpr double kFewestSamplesAPeriod = 2.5;
constexpr double kAtTheBound = 0.98;
// A mode of more than half of critical damping peaks by less than 1.3 dB: over the band it is a lag or a delay of 2 ζ /
// ω.
constexpr double kLightlyDamped = 0.5;

MechanismBounds bounds(const MechanismScales& scales) {
  const double slowest_hz = 3 / scales.longest_s, fastest_hz = 1 / (kFewestSamplesAPeriod * scales.sample_period_s);
  MechanismBounds bounds{.lower = {slowest_hz, 0.005},
                         .upper = {fastest_hz, 0.7},
                         .step = {1e-4 * std::sqrt(slowest_hz * fastest_hz), 1e-4},
                         .starts = {}};
  // A mode is found from as far as its own width: a seventh of its frequency.
  for (const double frequency : spread(8 * slowest_hz, 0.9 * fastest_hz, 32)) bounds.starts.push_back({frequency, 0.1});
  return bounds;
}

/// Whether the mode is faster than the sampling shows, or none.
bool is_no_mode(std::span<const double> parameters, std::span<const double>, std::span<const double> upper) {
  return parameters[kFrequency] > kAtTheBound * upper[kFrequency] || parameters[kDamping] > kLightlyDamped;
}

void filter(std::span<const double> parameters, const LawContext& context, std::span<double> signal) {
  if (!std::isfinite(parameters[kFrequency]) || signal.size() < 2) return;
  const Mode mode{2 * std::numbers::pi * parameters[kFrequency], parameters[kDamping]};
  read_behind_mode(mode, context.time_s[1] - context.time_s[0], signal);
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
    .reshape = nullptr,
    .is_cut_off = is_no_mode};

}  // namespace valvetriage
