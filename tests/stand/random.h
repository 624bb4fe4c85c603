#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string_view>

namespace valvetriage::stand {

/// Deterministic random numbers, equal on every machine: splitmix64 with one independent stream per purpose, so that
/// adding an effect or a test never shifts the draws of another.
class Random {
 public:
  Random(std::uint64_t seed, std::string_view purpose) : state_(mix(seed ^ hash(purpose))) {}

  std::uint64_t next() {
    state_ += 0x9E3779B97F4A7C15ULL;
    return mix(state_);
  }
  /// Uniform in [0, 1).
  double uniform() { return static_cast<double>(next() >> 11) * 0x1.0p-53; }
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  double log_uniform(double low, double high) { return low * std::pow(high / low, uniform()); }
  /// Standard normal (Box-Muller, one of the pair).
  double normal() {
    const double radius = std::sqrt(-2.0 * std::log(1.0 - uniform()));
    return radius * std::cos(2.0 * std::numbers::pi * uniform());
  }
  /// Normal, cut at three standard deviations: no unit is outside its drawing.
  double tolerance() {
    double value = normal();
    while (std::abs(value) > 3.0) value = normal();
    return value;
  }
  int below(int n) { return static_cast<int>(next() % static_cast<std::uint64_t>(n)); }

  static std::uint64_t hash(std::string_view text) {
    std::uint64_t h = 0xCBF29CE484222325ULL;
    for (const char c : text) h = (h ^ static_cast<unsigned char>(c)) * 0x100000001B3ULL;
    return h;
  }

 private:
  static std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ULL;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBULL;
    return z ^ (z >> 31);
  }
  std::uint64_t state_;
};

}  // namespace valvetriage::stand
