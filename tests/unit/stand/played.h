#pragma once

#include <cmath>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "tests/stand/session.h"
#include "tests/stand/valve.h"

namespace valvetriage::stand {

inline std::vector<double> play(const Unit& unit, const Command& command, const Faults& faults = {},
                                const Tolerance& tolerance = {}) {
  const Environment environment(7, command.name);
  return run_valve(unit, faults, command, environment, sample_times_s(command), tolerance);
}

/// Mean pressure over the last second of the hold at the level of a step recording.
inline double settled_psi(const std::vector<double>& pressure) {
  return std::accumulate(pressure.begin() + 900, pressure.begin() + 1100, 0.0) / 200;
}

inline double rms_difference(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

inline SessionOptions session_of(std::vector<std::string> tests, std::vector<EffectRequest> effects = {}) {
  SessionOptions options;
  options.tests = std::move(tests);
  options.effects = std::move(effects);
  return options;
}

/// Largest rms over the recordings of what the effects do to the noise-free output.
inline double signature_psi(const SessionOptions& options) {
  const Signature signature = signature_of(options);
  double largest = 0;
  for (std::size_t i = 0; i < signature.healthy.recordings.size(); ++i)
    largest = std::max(
        largest, rms_difference(signature.healthy.recordings[i].clean_psi, signature.spoiled.recordings[i].clean_psi));
  return largest;
}

}  // namespace valvetriage::stand
