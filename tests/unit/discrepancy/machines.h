#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage::machines {

/// Random numbers that are the same everywhere.
class Noise {
 public:
  explicit Noise(std::uint64_t seed) : state_(seed * 0x9E3779B97F4A7C15ULL + 1) {}
  double uniform() {
    state_ = state_ * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<double>(state_ >> 11U) / 9007199254740992.0;
  }
  double normal() {
    const double r = std::sqrt(-2 * std::log(uniform() + 1e-300));
    return r * std::cos(2 * std::numbers::pi * uniform());
  }

 private:
  std::uint64_t state_;
};

/// A command of random holds, rounded by a lag: broad band, with rests.
inline std::vector<double> random_command(std::size_t samples, std::size_t hold, std::uint64_t seed) {
  Noise noise(seed);
  std::vector<double> u(samples);
  double level = 0, value = 0;
  for (std::size_t t = 0; t < samples; ++t) {
    if (t % hold == 0) level = 4 * noise.uniform() - 2;
    value += 0.4 * (level - value);
    u[t] = value;
  }
  return u;
}

/// A sum of sines of rising frequency and equal amplitude about zero.
inline std::vector<double> multisine(std::size_t samples, int lines, std::uint64_t seed) {
  Noise noise(seed);
  std::vector<double> u(samples);
  for (int k = 1; k <= lines; ++k) {
    const double phase = 2 * std::numbers::pi * noise.uniform();
    for (std::size_t t = 0; t < samples; ++t) {
      u[t] += std::sin(2 * std::numbers::pi * k * 3 * static_cast<double>(t) / static_cast<double>(samples) + phase);
    }
  }
  for (double& value : u) value *= std::sqrt(2.0 / lines);
  return u;
}

inline Recording recording(std::vector<double> u, std::vector<double> y, double period_s, double noise_rms,
                           std::uint64_t seed) {
  Noise noise(seed);
  for (double& value : y) value += noise_rms * noise.normal();
  Recording r;
  r.name = "machine.csv";
  r.sample_period_s = period_s;
  r.input.name = "u";
  r.output.name = "y";
  r.time_s.resize(u.size());
  for (std::size_t t = 0; t < u.size(); ++t) r.time_s[t] = static_cast<double>(t) * period_s;
  r.input.values = std::move(u);
  r.output.values = std::move(y);
  return r;
}

/// A mass on a spring: ÿ = ω² (u − force(y, ẏ)) − 2 ζ ω ẏ, twenty Euler steps per sample.
struct Oscillator {
  double omega = 6, zeta = 0.3;
  std::function<double(double, double)> force = [](double y, double) { return y; };
  double coulomb = 0;  ///< friction in units of the input

  std::vector<double> run(const std::vector<double>& u, double period_s) const {
    constexpr int kSteps = 20;
    const double h = period_s / kSteps;
    double y = force(0, 0) == 0 ? u[0] : 0, v = 0;
    if (coulomb > 0) y = 0;
    std::vector<double> out(u.size());
    for (std::size_t t = 0; t < u.size(); ++t) {
      out[t] = y;
      const double next = t + 1 < u.size() ? u[t + 1] : u[t];
      for (int s = 0; s < kSteps; ++s) {
        const double now = u[t] + (next - u[t]) * s / kSteps;
        const double push = omega * omega * (now - force(y, v)) - 2 * zeta * omega * v;
        const double free = v + h * push;
        const double hold = h * omega * omega * coulomb;
        v = std::abs(free) <= hold ? 0 : free - std::copysign(hold, free);
        y += h * v;
      }
    }
    return out;
  }
};

/// First-order lag of static gain 1.
inline std::vector<double> lag(const std::vector<double>& u, double tau_s, double period_s) {
  std::vector<double> y(u.size());
  double state = u[0];
  for (std::size_t t = 0; t < u.size(); ++t) {
    y[t] = state;
    state += (1 - std::exp(-period_s / tau_s)) * (u[t] - state);
  }
  return y;
}

inline std::vector<double> each(std::vector<double> values, const std::function<double(double)>& law) {
  for (double& value : values) value = law(value);
  return values;
}

inline std::vector<double> play(const std::vector<double>& u, double width) {
  std::vector<double> y(u.size());
  double held = u[0];
  for (std::size_t t = 0; t < u.size(); ++t) {
    held = std::max(u[t] - width / 2, std::min(u[t] + width / 2, held));
    y[t] = held;
  }
  return y;
}

}  // namespace valvetriage::machines
