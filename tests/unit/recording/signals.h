#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "core/recording/prepare.h"

namespace valvetriage {

using Signal = std::vector<double>;

/// Inputs of the stand's repertoire at 200 Hz, in A.
inline Signal steps_of(const std::vector<double>& levels, std::size_t samples_each) {
  Signal u;
  for (const double level : levels) u.insert(u.end(), samples_each, level);
  return u;
}

inline Signal triangle_of(std::size_t samples, std::size_t period) {
  Signal u(samples);
  for (std::size_t i = 0; i < samples; ++i) {
    const double phase = static_cast<double>(i % period) / static_cast<double>(period);
    u[i] = 1.2 + 0.8 * (phase < 0.5 ? 2 * phase : 2 - 2 * phase);
  }
  return u;
}

inline Signal swept_sine_of(std::size_t samples) {
  Signal u(samples);
  for (std::size_t i = 0; i < samples; ++i) {
    const double t = static_cast<double>(i) / 200.0;
    u[i] = 1.6 + 0.1 * std::sin(2 * std::numbers::pi * (0.2 * t + 0.2 * t * t));  // 0.2 to 8 Hz in 20 s
  }
  return u;
}

/// Sum of 20 tones up to 5 Hz with random phases.
inline Signal multisine_of(std::size_t samples, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> phase(0, 2 * std::numbers::pi);
  Signal u(samples, 1.6);
  for (int k = 1; k <= 20; ++k) {
    const double shift = phase(random);
    for (std::size_t i = 0; i < samples; ++i) {
      u[i] += 0.02 * std::sin(2 * std::numbers::pi * 0.25 * k * static_cast<double>(i) / 200.0 + shift);
    }
  }
  return u;
}

inline void add_noise(Signal& signal, double sigma, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(0, sigma);
  for (double& value : signal) value += noise(random);
}

/// A valve of second order, 60 ms and 15 ms, 150 psi/A, in steady state at the first input.
inline Signal response_of(const Signal& u) {
  Signal y(u.size());
  double first = 150 * (u.front() - 0.8), second = first;
  for (std::size_t i = 0; i < u.size(); ++i) {
    y[i] = second;
    first += (150 * (u[i] - 0.8) - first) * (1 - std::exp(-0.005 / 0.060));
    second += (first - second) * (1 - std::exp(-0.005 / 0.015));
  }
  return y;
}

inline RawRecording raw_of(Signal u, Signal y) {
  RawRecording raw;
  raw.name = "valve.csv";
  raw.time.name = "time_s";
  for (std::size_t i = 0; i < u.size(); ++i) raw.time.values.push_back(0.005 * static_cast<double>(i));
  raw.input = {.name = "current_A", .quantity = "current", .unit = "A", .file_unit = "A", .values = std::move(u)};
  raw.output = {
      .name = "pressure_psi", .quantity = "pressure", .unit = "psi", .file_unit = "psi", .values = std::move(y)};
  return raw;
}

/// What a stand with 0.5 mA and 0.35 psi of noise records, written with four decimals.
inline RawRecording recorded(const Signal& command, unsigned seed) {
  Signal u = command, y = response_of(command);
  add_noise(u, 0.0005, 2 * seed + 1);
  add_noise(y, 0.35, 2 * seed + 2);
  for (double& value : u) value = std::round(value * 1e4) / 1e4;
  for (double& value : y) value = std::round(value * 1e4) / 1e4;
  return raw_of(std::move(u), std::move(y));
}

inline const QualityItem* find_quality(const Recording& recording, const std::string& code) {
  for (const QualityItem& item : recording.quality) {
    if (item.code == code) return &item;
  }
  return nullptr;
}

/// As the readers prepare it; a failure of the test where they refuse it.
inline Recording prepared(RawRecording raw) {
  auto recording = prepare_recording(std::move(raw), {});
  EXPECT_TRUE(recording.has_value()) << recording.error().message;
  return recording.value_or(Recording{});
}

}  // namespace valvetriage
