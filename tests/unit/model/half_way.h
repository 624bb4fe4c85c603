#pragma once

#include <vector>

namespace valvetriage::test {

inline constexpr double kPeriod_s = 0.005;  ///< of the recordings of a test stand

/// Two values a sample, there and half-way to the next, straight between samples and held after the last.
inline std::vector<double> straight_between(const std::vector<double>& samples) {
  std::vector<double> halves(2 * samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    halves[2 * i] = samples[i];
    halves[2 * i + 1] = i + 1 < samples.size() ? 0.5 * (samples[i] + samples[i + 1]) : samples[i];
  }
  return halves;
}

}  // namespace valvetriage::test
