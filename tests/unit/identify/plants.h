#pragma once

#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "core/recording/recording.h"

namespace valvetriage::test {

/// A difference equation to take data from: y_t = Σ b_i u_{t−k−i} − Σ_{j≥1} a_j y_{t−j}, a[0] = 1, at rest before.
struct Plant {
  std::vector<double> b, a;
  int delay = 0;
};

inline std::vector<double> run(const Plant& plant, const std::vector<double>& u) {
  std::vector<double> y(u.size());
  for (std::size_t t = 0; t < u.size(); ++t) {
    for (std::size_t i = 0; i < plant.b.size(); ++i) {
      const std::size_t lag = static_cast<std::size_t>(plant.delay) + i;
      if (t >= lag) y[t] += plant.b[i] * u[t - lag];
    }
    for (std::size_t j = 1; j < plant.a.size() && j <= t; ++j) y[t] -= plant.a[j] * y[t - j];
  }
  return y;
}

/// Normal numbers that are the same on every standard library (std::normal_distribution is not): Box and Muller.
class Normal {
 public:
  explicit Normal(std::uint32_t seed) : engine_(seed) {}
  double operator()() {
    const double u1 = (bits() + 1.0) / 4294967297.0;
    const double u2 = bits() / 4294967296.0;
    return std::sqrt(-2 * std::log(u1)) * std::cos(2 * std::numbers::pi * u2);
  }
  std::uint32_t bits() { return static_cast<std::uint32_t>(engine_()); }

 private:
  std::mt19937 engine_;
};

/// Levels held for a random while: what a staircase of a stand looks like, and rich enough to identify from.
inline std::vector<double> random_levels(std::size_t n, std::size_t shortest_hold, std::uint32_t seed) {
  Normal normal(seed);
  std::vector<double> u(n);
  double level = 1.5;
  std::size_t hold = shortest_hold;
  for (auto& value : u) {
    if (hold-- == 0) {
      level = 1.6 + 0.2 * normal();
      hold = shortest_hold + normal.bits() % (4 * shortest_hold);
    }
    value = level;
  }
  return u;
}

inline void add_noise(std::vector<double>& y, double sd, std::uint32_t seed) {
  Normal normal(seed);
  for (auto& value : y) value += sd * normal();
}

inline Recording recording_of(std::vector<double> u, std::vector<double> y, double sample_period_s) {
  Recording r;
  r.name = "test";
  r.sample_period_s = sample_period_s;
  r.time_s.resize(u.size());
  for (std::size_t t = 0; t < u.size(); ++t) r.time_s[t] = static_cast<double>(t) * sample_period_s;
  r.input.values = std::move(u);
  r.output.values = std::move(y);
  return r;
}

/// A second-order valve sampled at 200 Hz: 2.5 Hz, damping 0.7, static gain 470 psi/A.
inline Plant second_order_valve() {
  const double period = 1.0 / 200;
  const double omega = 2 * std::numbers::pi * 2.5;
  const double zeta = 0.7;
  const double radius = std::exp(-zeta * omega * period);
  const double angle = omega * std::sqrt(1 - zeta * zeta) * period;
  const double a1 = -2 * radius * std::cos(angle);
  const double a2 = radius * radius;
  const double b = 470 * (1 + a1 + a2) / 2;
  return {.b = {b, b}, .a = {1, a1, a2}, .delay = 1};
}

}  // namespace valvetriage::test
