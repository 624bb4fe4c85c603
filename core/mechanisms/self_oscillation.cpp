// self_oscillation: hunting; a limit cycle that lives around one level, its frequency following the level.
//
//   y ← y + A r cos φ,   dr/dt = g r (D − r²),   D = max(1 − ((y − L) / w)², −1),   dφ/dt = 2π f (1 + s (y − L) / R)
//
// The normal form of a Hopf bifurcation: inside L ± w the cycle grows to √D at the rate g, outside it dies out. While
// it is dead (r = 1/1000) its phase waits at `phase_rad`, so the phase counts from the instant at which the level is
// entered, not from the start of the recording. So it is where nothing but the input is known. What the cycle begins
// with is whatever stirs the valve, and its phase drifts: against a reading, amplitude, level and frequency are the
// law, and the phase is that of the reading around each sample, the sample itself and its neighbours left out.
//
// Source     Guckenheimer and Holmes, Nonlinear Oscillations (1983), section 3.4; instability of pressure valves:
//            Merritt, Hydraulic Control Systems (1967), chapter 9
// Looks like a tone on holds near one level, none elsewhere, that takes time to grow
// Confused   with periodic_disturbance (at every level), resonance (dies out on holds)

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

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
     {"phase_rad", "rad", "of a free run, at the instant the level is entered; in a reading it is followed", 0}}};
constexpr std::array<std::string_view, 2> kConfusedWith{"periodic_disturbance", "resonance"};
constexpr double kDead = 1e-3;            // a cycle of one thousandth shows in no recording
constexpr double kWidest = 0.5;           // of the range: a cycle that lives at more levels is not around one of them
constexpr double kLongestMemory_s = 0.5;  // the phase of a valve that hunts stays for this long
constexpr double kForgotten_s = 0.1;      // coloured noise of a gauge or a pump is another one by then

MechanismBounds bounds(const MechanismScales& scales) {
  const double range = scales.output_range, slowest_hz = 3 / scales.longest_s;
  const double fastest_hz = 0.45 / scales.sample_period_s;
  MechanismBounds bounds{
      .lower = {slowest_hz, 0, scales.output_low, 0.03 * range, -1, 3 / scales.longest_s, -std::numbers::pi},
      .upper = {fastest_hz, range, scales.output_high, kWidest * range, 1, fastest_hz, std::numbers::pi},
      .step = {1e-4 * slowest_hz, 1e-4 * range, 1e-3 * range, 1e-3 * range, 1e-3, 1e-2, 0},
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

/// The cycle at one sample: its radius, and its phase since the start of the recording.
struct Turning {
  double radius = 0;
  std::complex<double> turn;  ///< e^(iφ)
};

/// The cycle along a reading without it. `waits`: while it is dead its phase is that of the parameters.
std::vector<Turning> turning(std::span<const double> parameters, const LawContext& context, std::span<const double> y,
                             bool waits) {
  const double period = context.time_s[1] - context.time_s[0];
  const double turn = 2 * std::numbers::pi * parameters[kFrequency] * period;
  const double slope = context.output_range > 0 ? parameters[kFrequencySlope] / context.output_range : 0;
  double r = kDead, phase = parameters[kPhase];
  std::vector<Turning> cycle(y.size());
  for (std::size_t i = 0; i < y.size(); ++i) {
    const double from = y[i] - parameters[kLevel];
    const double far = from / parameters[kWidth];
    const double drive = std::max(1 - far * far, -1.0);
    cycle[i] = {r > kDead ? r : 0, std::polar(1.0, phase)};
    r = std::max(grown(r, drive, parameters[kGrowth] * period), kDead);
    phase = waits && r <= kDead ? parameters[kPhase] : phase + turn * (1 + slope * from);
  }
  return cycle;
}

/// Mean of cos(ψ − ψ̂) where ψ is known from data that speak for ψ̂ with κ: I₁(κ) / I₀(κ), by the bound of Amos, Math.
/// Comp. 28 (1974) 239, which is within 0.02 of it.
double resultant(double kappa) {
  return kappa / (0.5 + std::sqrt(kappa * kappa + 2.25));
}

/// What is left of the reading beside `y`, its mean over one period taken off, no larger than noise and the cycle make
/// it: an edge that the simulation misses is no oscillation.
std::vector<double> left_beside(std::span<const double> y, const LawContext& context, std::size_t period,
                                double largest) {
  const std::size_t n = y.size();
  std::vector<double> left(n), sums(n + 1, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    const double error = context.measured[i] - y[i];
    left[i] = std::isfinite(error) ? error : 0;
    sums[i + 1] = sums[i] + left[i];
  }
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t first = i > period / 2 ? i - period / 2 : 0, last = std::min(n, first + period);
    const double mean = (sums[last] - sums[first]) / static_cast<double>(last - first);
    left[i] = std::clamp(left[i] - mean, -largest, largest);
  }
  return left;
}

/// Samples by which what is followed is forgotten: as many as tell the cycle's size to a fifth, no more than half a
/// second of them, for a phase drifts, and no fewer than half a period.
double memory_of(double amplitude, double variance, double period, double sample_s) {
  constexpr double kToAFifth = 12.5;
  return 0.5 * period + 1 / (sample_s / kLongestMemory_s + amplitude * amplitude / (kToAFifth * variance));
}

/// What the reading on one side of each sample shows of the cycle.
struct Followed {
  std::complex<double> seen;  ///< Σ w e r e^(−iφ)
  double weight = 0;          ///< Σ w r²
};

/// Adds what lies before each sample, `beside` samples away and farther, as long as the cycle has lived on till then;
/// with everything turned round, what lies behind it.
void follow(std::span<const Turning> cycle, std::span<const double> left, std::size_t beside, double keep,
            bool backwards, std::span<Followed> followed) {
  const std::size_t n = cycle.size();
  const auto at = [&](std::size_t i) { return backwards ? n - 1 - i : i; };
  Followed now;
  std::size_t lived = 0;
  for (std::size_t i = 0; i < n; ++i) {
    lived = cycle[at(i)].radius > 0 ? lived + 1 : 0;
    if (lived == 0) now = {};
    if (lived <= beside) continue;
    const std::size_t j = at(i - beside);
    const double r = cycle[j].radius;
    now.seen = keep * now.seen + left[j] * r * std::conj(cycle[j].turn);
    now.weight = keep * now.weight + r * r;
    followed[at(i)].seen += now.seen;
    followed[at(i)].weight += now.weight;
  }
}

/// The cycle as the reading around each sample shows it. No law foretells the phase of a valve that hunts, nor when it
/// begins: it grows out of whatever stirs the valve, and drifts. But it stays for a while, so that the reading before
/// and behind tells it, without what lies nearer than half a period or than noise remembers: noise follows nothing.
/// Where the reading does not tell the phase, the mean over all phases that may be is less than the cycle, and no more
/// of it is there than two standard errors above what is seen.
void add_followed(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  const double amplitude = parameters[kAmplitude], sample_s = context.time_s[1] - context.time_s[0];
  const double period = std::max(2.0, 1 / (parameters[kFrequency] * sample_s));
  const auto beside = static_cast<std::size_t>(std::lround(std::max(0.5 * period, kForgotten_s / sample_s)));
  const double variance = std::max(context.noise_rms * context.noise_rms, 1e-300);
  const double keep = std::exp(-1 / memory_of(amplitude, variance, period, sample_s));
  const std::vector<Turning> cycle = turning(parameters, context, y, false);
  const std::vector<double> left =
      left_beside(y, context, static_cast<std::size_t>(std::lround(period)), amplitude + 4 * context.noise_rms);
  std::vector<Followed> followed(y.size());
  follow(cycle, left, beside, keep, false, followed);
  follow(cycle, left, beside, keep, true, followed);
  for (std::size_t i = 0; i < y.size(); ++i) {
    const double length = std::abs(followed[i].seen), weight = followed[i].weight;
    if (!(length > 0)) continue;
    const double there = (2 * length + 2 * std::sqrt(variance * weight)) / weight;
    const double size = std::min(amplitude * resultant(amplitude * length / variance), there);
    y[i] += size * cycle[i].radius * (cycle[i].turn * followed[i].seen / length).real();
  }
}

void apply(std::span<const double> parameters, const LawContext& context, std::span<double> y) {
  const double amplitude = parameters[kAmplitude];
  if (amplitude == 0 || y.size() < 2) return;
  if (context.measured.size() == y.size()) return add_followed(parameters, context, y);
  const std::vector<Turning> cycle = turning(parameters, context, y, true);
  for (std::size_t i = 0; i < y.size(); ++i) y[i] += amplitude * cycle[i].radius * cycle[i].turn.real();
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
