#pragma once

#include <cmath>
#include <functional>
#include <random>

#include "core/recording/recording.h"

namespace valvetriage::test {

/// Step response of a lag: 100 psi, 0.15 s.
inline double lag(double t_s) {
  return 100 * (1 - std::exp(-t_s / 0.15));
}

/// Current at rest, one step up at `step_s`, held to the end; the output follows `response` of the time since the step.
inline Recording step_recording(double rate_hz, double rest_a, double level_a, double step_s, double end_s,
                                const std::function<double(double)>& response, double noise, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Recording recording;
  recording.name = "step.csv";
  recording.test = TestKind::kStep;
  recording.sample_period_s = 1.0 / rate_hz;
  recording.input.unit = "A";
  recording.output.unit = "psi";
  const auto n = static_cast<std::size_t>(std::llround(end_s * rate_hz));
  const auto step = static_cast<std::size_t>(std::llround(step_s * rate_hz));
  for (std::size_t i = 0; i < n; ++i) {
    const double since = (static_cast<double>(i) - static_cast<double>(step)) / rate_hz;
    recording.time_s.push_back(static_cast<double>(i) / rate_hz);
    recording.input.values.push_back(i < step ? rest_a : level_a);
    recording.output.values.push_back((since < 0 ? response(0) : response(since)) + noise * normal(random));
  }
  recording.segments = {{.kind = SegmentKind::kHold, .begin = 0, .end = step, .level = rest_a},
                        {.kind = SegmentKind::kStep, .begin = step, .end = n, .level = level_a, .from_level = rest_a}};
  return recording;
}

}  // namespace valvetriage::test
