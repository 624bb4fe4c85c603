#pragma once

#include <cmath>
#include <complex>
#include <numbers>
#include <string>
#include <vector>

#include "core/identify/frequency_response.h"
#include "core/model/model.h"
#include "core/recording/quality.h"
#include "core/recording/segments.h"
#include "tests/unit/identify/plants.h"

namespace valvetriage::test {

/// A continuous plant of second-order modes, real poles and real zeros, static gain 1 times `gain`; corners in Hz.
inline TransferFunction plant_s(double gain, const std::vector<double>& pole_hz,
                                const std::vector<std::pair<double, double>>& modes_hz_damping,
                                const std::vector<double>& zero_hz = {}, double delay_s = 0) {
  constexpr double kTwoPi = 2 * std::numbers::pi;
  TransferFunction g{.domain = Domain::kS, .delay_s = delay_s};
  for (const double hz : pole_hz) g.poles.emplace_back(-kTwoPi * hz);
  for (const auto& [hz, damping] : modes_hz_damping) {
    const double w = kTwoPi * hz;
    g.poles.emplace_back(-damping * w, w * std::sqrt(1 - damping * damping));
    g.poles.emplace_back(-damping * w, -w * std::sqrt(1 - damping * damping));
  }
  for (const double hz : zero_hz) g.zeros.emplace_back(-kTwoPi * hz);
  g.gain = gain / static_gain(g);
  return g;
}

inline std::vector<double> swept_sine(std::size_t n, double rate_hz, double from_hz, double to_hz, double amplitude,
                                      double mean = 1.6) {
  std::vector<double> u(n);
  const double duration_s = static_cast<double>(n) / rate_hz;
  const double length_s = duration_s / std::log(to_hz / from_hz);
  for (std::size_t i = 0; i < n; ++i) {
    const double t = static_cast<double>(i) / rate_hz;
    u[i] = mean + amplitude * std::sin(2 * std::numbers::pi * from_hz * length_s * std::expm1(t / length_s));
  }
  return u;
}

/// What the plant makes of an input that goes straight between its samples, from its steady state.
inline Recording recording_of(const TransferFunction& g, std::vector<double> u, double rate_hz, double noise_sd = 0,
                              std::uint32_t seed = 1) {
  Recording recording;
  recording.name = "made.csv";
  recording.test = TestKind::kSweep;
  recording.sample_period_s = 1 / rate_hz;
  recording.input.unit = "A";
  recording.output.unit = "psi";
  Model model{.kind = "linear", .dynamics = g};
  model.input_offset = 1.6;
  model.output_offset = 100;
  recording.input.values = std::move(u);
  recording.segments = {{SegmentKind::kSweep, 0, recording.samples()}};
  recording.output.values.assign(recording.samples(), 0.0);
  recording.output.values = simulate(model, recording, InitialState{}).value();
  Normal normal(seed);
  for (double& y : recording.output.values) y += noise_sd * normal();
  return recording;
}

/// A response as the fit sees it: the plant's own, with circular normal errors of a given size relative to its rms.
inline FrequencyResponse response_of(const TransferFunction& g, double from_hz, double to_hz, std::size_t points,
                                     double noise_ratio, std::uint32_t seed) {
  FrequencyResponse response;
  Normal normal(seed);
  std::vector<double> f;
  for (std::size_t k = 0; k < points; ++k) {
    f.push_back(from_hz * std::pow(to_hz / from_hz, static_cast<double>(k) / static_cast<double>(points - 1)));
  }
  const auto gain = frequency_response(g, f);
  for (std::size_t k = 0; k < points; ++k) {
    const double sd = noise_ratio * std::abs(gain[k]);
    const std::complex<double> error(normal() * sd / std::numbers::sqrt2, normal() * sd / std::numbers::sqrt2);
    response.points.push_back({.frequency_hz = f[k],
                               .gain = gain[k] + error,
                               .std_error = sd,
                               .coherence = 1 / (1 + noise_ratio * noise_ratio),
                               .degrees_of_freedom = 1e6,
                               .group = static_cast<int>(k)});
  }
  return response;
}

}  // namespace valvetriage::test
