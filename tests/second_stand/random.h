#pragma once

#include <cmath>
#include <cstdint>
#include <string_view>

namespace valvetriage::second_stand {

/// Deterministic random numbers: PCG32 (O'Neill 2014, XSH-RR), one stream per purpose, so that a new effect or test
/// never shifts the draws of another.
class Random {
 public:
  Random(std::uint64_t seed, std::string_view purpose) : stream_(2 * digest(purpose) + 1) {
    bits();
    state_ += seed;
    bits();
  }

  /// Uniform in (0, 1).
  double uniform() { return (static_cast<double>(bits()) + 0.5) * 0x1.0p-32; }
  double between(double low, double high) { return low + (high - low) * uniform(); }
  double log_between(double low, double high) { return low * std::exp(uniform() * std::log(high / low)); }
  bool chance(double probability) { return uniform() < probability; }
  double sign() { return chance(0.5) ? -1 : 1; }
  int below(int n) { return static_cast<int>(uniform() * n); }
  std::uint64_t seed() { return (static_cast<std::uint64_t>(bits()) << 32) | bits(); }

  /// Standard normal by the polar method; the second of a pair is not kept, so that a draw has no memory.
  double normal() {
    for (;;) {
      const double a = between(-1, 1), b = between(-1, 1), squares = a * a + b * b;
      if (squares < 1) return a * std::sqrt(-2 * std::log(squares) / squares);
    }
  }
  /// Normal within three standard deviations: what final inspection lets through.
  double inspected() {
    double value = normal();
    while (std::abs(value) > 3) value = normal();
    return value;
  }

  static std::uint64_t digest(std::string_view text) {
    std::uint64_t h = 0x2545F4914F6CDD1DULL;
    for (const char c : text) {
      h = (h + static_cast<unsigned char>(c)) * 0xD6E8FEB86659FD93ULL;
      h ^= h >> 32;
    }
    return h;
  }

 private:
  std::uint32_t bits() {
    const std::uint64_t old = state_;
    state_ = old * 6364136223846793005ULL + stream_;
    const auto folded = static_cast<std::uint32_t>(((old >> 18) ^ old) >> 27);
    const auto turn = static_cast<std::uint32_t>(old >> 59);
    return (folded >> turn) | (folded << ((32 - turn) & 31));
  }

  std::uint64_t state_ = 0, stream_;
};

}  // namespace valvetriage::second_stand
