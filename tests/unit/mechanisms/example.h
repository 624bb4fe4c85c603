#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>
#include <vector>

#include "core/mechanisms/mechanism.h"

namespace valvetriage::example {

inline constexpr double kPeriod_s = 0.005;
inline constexpr std::size_t kSamples = 2000;

/// Stamps of a recording of ten seconds; `per_sample` 2 as kInput has them.
inline std::vector<double> stamps(std::size_t per_sample = 1) {
  std::vector<double> t;
  for (std::size_t i = 0; i < kSamples; ++i) {
    t.push_back(static_cast<double>(i) * kPeriod_s);
    if (per_sample == 2) t.push_back(static_cast<double>(i + 1) * kPeriod_s);
  }
  return t;
}

/// A signal that goes back and forth over a range at several rates, and jumps from end to end at last.
inline std::vector<double> motion(double low, double high, const std::vector<double>& time_s) {
  std::vector<double> x;
  for (const double t : time_s) {
    const double wave = 0.45 * std::sin(1.3 * t + 0.4) + 0.3 * std::sin(7.1 * t) + 0.25 * std::sin(2.9 * t * t / 3);
    const double place = t < 8 ? 0.5 + 0.5 * wave : std::sin(7 * t) > 0 ? 1 : 0;
    x.push_back(low + (high - low) * place);
  }
  return x;
}

/// Largest difference of two signals of one length.
inline double largest_gap(const std::vector<double>& a, const std::vector<double>& b) {
  double gap = 0;
  for (std::size_t i = 0; i < a.size(); ++i) gap = std::max(gap, std::abs(a[i] - b[i]));
  return gap;
}

inline MechanismScales scales() {
  return {.sample_period_s = kPeriod_s,
          .longest_s = 10,
          .input_low = 1.0,
          .input_high = 2.0,
          .output_low = 1,
          .output_high = 210,
          .output_range = 210,
          .slope = 470,
          .recordings = 3,
          .side = {{18, 22, 20}}};
}

/// Two channels of a valve's record.
inline const std::vector<Channel>& side() {
  static const std::vector<Channel> channels = [] {
    Channel channel{.name = "temperature_C", .quantity = "temperature", .unit = "", .file_unit = "", .values = {}};
    for (const double t : stamps()) channel.values.push_back(40 + 2 * std::sin(0.7 * t));
    return std::vector<Channel>{channel};
  }();
  return channels;
}

/// What a law sees: output signals of 1 to 210 psi (a bipolar one for a magnitude), inputs of 1 to 2 A.
struct Sight {
  std::vector<double> time_s, signal, input;
  LawContext context;

  explicit Sight(const Mechanism& law) {
    const bool of_input = law.place == Place::kInput || law.place == Place::kPosition;
    time_s = stamps(law.place == Place::kInput ? 2 : 1);
    const bool bipolar = law.cause == "rectified_sensor";
    signal = motion(of_input ? 1.0 : bipolar ? -100 : 1, of_input ? 2.0 : 210, time_s);
    input = motion(1, 2, time_s);
    context = {.time_s = time_s,
               .output_range = 210,
               .steady = {},
               .driver = {},
               .side = side(),
               .recording = 0,
               .input = input,
               .input_middle = 1.5,
               .rest_input = 1.0,
               .secant = 209};
  }
  Sight(const Sight&) = delete;

  std::vector<double> behind(const Mechanism& law, const std::vector<double>& parameters) const {
    std::vector<double> y = signal;
    law.apply(parameters, context, y);
    return y;
  }
};

/// A start of the law with the effect taken out of it.
inline std::vector<double> neutral(const Mechanism& law, std::vector<double> start) {
  if (law.size_parameter < start.size()) start[law.size_parameter] = law.neutral;
  return start;
}

}  // namespace valvetriage::example
