#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "core/identify/valve_fit.h"
#include "core/model/valve_dynamics.h"

namespace valvetriage::test {

inline constexpr double kNoise_psi = 0.35;  ///< of the stand's sensor, white

/// A made-up valve of exactly the fitted structure: magnetic loop, spool, smooth map, volume.
struct MadeValve {
  ValveParameters parameters{
      .spool = {.delay_s = 0.0072, .natural_frequency_rad_s = 120, .damping_ratio = 0.9},
      .loop_width_a = 0.0045,
      .volume = {.time_constant_s = 0.06, .exponent = 0.5, .supply_psi = 480, .reference_psi = 105},
      .narrow_loop_width_a = 0.0015};
  double scale = 1;       ///< of the map
  double current = 1;     ///< of all currents, the loop's too: at 0.1 a valve of 100 to 220 mA
  UsualMechanisms usual;  ///< and how its commands are played

  double map(double current_a) const {
    const double x = std::clamp((current_a / current - 1.0) / 1.2, 0.0, 1.0);
    return scale * 220 * x * x * (3 - 2 * x);
  }
};

/// The same valve with another coil: everything that is told in A times `current`.
inline MadeValve with_currents_times(double current, MadeValve valve = {}) {
  valve.current *= current;
  valve.parameters.loop_width_a *= current;
  valve.parameters.narrow_loop_width_a *= current;
  valve.usual.current_scale *= current;
  return valve;
}

/// The pressure that the valve's equations give under an input.
inline std::vector<double> pressure_of(const MadeValve& valve, const IntervalSignal& between_samples,
                                       double sample_period_s) {
  const IntervalSignal input = halved(between_samples);
  const MagneticLoop loop = loop_of(valve.parameters, valve.usual);
  std::vector<double> steady(input.start.size()), pressure(between_samples.start.size());
  SampledValveDynamics(valve.parameters.spool, 0.5 * sample_period_s)
      .run(loop.apply(input, loop_driver(input, loop_gate(input))), steady);
  for (double& x : steady) x = valve.map(x);
  run_volume(valve.parameters.volume, sample_period_s, steady.front(), steady, pressure);
  if (valve.parameters.mode) read_behind_mode(*valve.parameters.mode, sample_period_s, pressure);
  return pressure;
}

/// A valve whose dynamics follow its map: the spool is prompt, and what fills behind it overshoots.
inline MadeValve with_a_mode(const Mode& mode = {40, 0.6}) {
  MadeValve valve;
  valve.usual.prompt_spool_rad_s = 1600;
  valve.parameters.spool = {.delay_s = 0.0072, .natural_frequency_rad_s = 1600};
  valve.parameters.volume = {.time_constant_s = 0.01, .exponent = 1, .supply_psi = 900, .reference_psi = 105};
  valve.parameters.mode = mode;
  return valve;
}

inline Recording played(const MadeValve& valve, TestKind test, const std::vector<double>& current,
                        std::vector<Segment> segments, double noise, unsigned seed) {
  Recording recording;
  recording.name = to_string(test) + ".csv";
  recording.test = test;
  recording.sample_period_s = 0.005;
  recording.input.unit = "A";
  recording.output.unit = "psi";
  recording.input.values = current;
  recording.segments = std::move(segments);
  recording.output.values.resize(current.size());
  for (std::size_t i = 0; i < current.size(); ++i) recording.time_s.push_back(static_cast<double>(i) * 0.005);
  std::vector<double>& y = recording.output.values;
  y = pressure_of(valve, input_between_samples(recording, valve.usual.input_between), 0.005);
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  for (double& sample : y) sample += noise * normal(random);
  return recording;
}

/// level  of a valve of 1.0 to 2.2 A [A]
inline Recording step_to(const MadeValve& valve, double level, double noise, unsigned seed) {
  const double rest_a = 1.0 * valve.current, level_a = level * valve.current;
  std::vector<double> current(1200, rest_a);
  std::fill(current.begin() + 200, current.begin() + 800, level_a);
  return played(valve, TestKind::kStep, current,
                {{.kind = SegmentKind::kHold, .begin = 0, .end = 200, .level = rest_a},
                 {.kind = SegmentKind::kStep, .begin = 200, .end = 800, .level = level_a, .from_level = rest_a},
                 {.kind = SegmentKind::kStep, .begin = 800, .end = 1200, .level = rest_a, .from_level = level_a}},
                noise, seed);
}

inline Recording triangle(const MadeValve& valve, double noise, unsigned seed) {
  std::vector<double> current(4000);
  for (std::size_t i = 0; i < current.size(); ++i) {
    const double x = static_cast<double>(i) / 2000.0;
    current[i] = valve.current * (1.0 + 1.1 * (x < 1 ? x : 2 - x));
  }
  return played(
      valve, TestKind::kTriangle, current,
      {{.kind = SegmentKind::kRamp, .begin = 0, .end = 2000}, {.kind = SegmentKind::kRamp, .begin = 2000, .end = 4000}},
      noise, seed);
}

/// From 0.1 to 10 Hz in 20 s around 1.6 A (times the valve's currents), a tenth of an ampere each way.
inline Recording sweep(const MadeValve& valve, double noise, unsigned seed) {
  constexpr double kFrom_hz = 0.1, kTo_hz = 10, kDuration_s = 20;
  std::vector<double> current(4000);
  for (std::size_t i = 0; i < current.size(); ++i) {
    const double t = 0.005 * static_cast<double>(i), growth = std::log(kTo_hz / kFrom_hz) / kDuration_s;
    const double cycles = kFrom_hz * std::expm1(growth * t) / growth;
    current[i] = valve.current * (1.6 + 0.1 * std::sin(2 * std::numbers::pi * cycles));
  }
  return played(valve, TestKind::kSweep, current, {{.kind = SegmentKind::kSweep, .begin = 0, .end = 4000}}, noise,
                seed);
}

/// A session: steps to 1.4, 1.6 and 1.8 A (times the valve's currents) and a triangle.
inline std::vector<Recording> session(const MadeValve& valve, double noise, unsigned seed) {
  return {step_to(valve, 1.4, noise, seed), step_to(valve, 1.6, noise, seed + 1), step_to(valve, 1.8, noise, seed + 2),
          triangle(valve, noise, seed + 3)};
}

}  // namespace valvetriage::test
