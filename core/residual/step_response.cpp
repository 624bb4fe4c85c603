#include "core/residual/step_response.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace valvetriage {
namespace {

// Rates are computed from stamps: a recording of 199.99 Hz serves a window of 200 Hz.
constexpr double kRateTolerance = 1e-3;

/// Samples of the recording that the window spans, or nothing where they are not all there.
std::optional<std::size_t> covered_samples(const Recording& recording, const StepWindow& step,
                                           const Eq20Window& window) {
  if (recording.sample_rate_hz() < window.rate_hz * (1 - kRateTolerance)) return std::nullopt;
  const auto needed = static_cast<std::size_t>(std::llround(window.duration_s / recording.sample_period_s));
  if (needed == 0 || step.begin + needed > step.end) return std::nullopt;
  for (std::size_t i = step.begin; i < step.begin + needed; ++i) {
    if (!recording.is_valid(i)) return std::nullopt;
  }
  return needed;
}

std::size_t tail_begin(const StepWindow& step, std::size_t samples) {
  return step.begin + samples - std::max<std::size_t>(1, samples / 10);
}

double mean_of(std::span<const double> values, std::size_t begin, std::size_t end) {
  double sum = 0;
  for (std::size_t i = begin; i < end; ++i) sum += values[i];
  return sum / static_cast<double>(end - begin);
}

double median_of_five(std::span<const double> values, std::size_t centre) {
  std::array<double, 5> five{};
  for (std::size_t k = 0; k < 5; ++k) five[k] = values[centre - 2 + k];
  std::nth_element(five.begin(), five.begin() + 2, five.end());
  return five[2];
}

}  // namespace

bool is_same_level(double a, double b, double current_scale) {
  constexpr double kTolerance_a = 0.02;
  return std::abs(a - b) < kTolerance_a * current_scale;
}

double rounded_level(double level, double current_scale) {
  // No farther from the level than half of what makes two levels one.
  const double decades = std::max(0.0, std::ceil(-std::log10(current_scale) - 0.5));
  const double per_unit = 100 * std::pow(10.0, decades);
  return std::round(level * per_unit) / per_unit;
}

std::vector<StepWindow> rising_steps(const Recording& recording, std::size_t recording_index) {
  std::vector<StepWindow> steps;
  for (const Segment& segment : recording.segments) {
    if (segment.kind == SegmentKind::kStep && segment.level > segment.from_level) {
      steps.push_back({recording_index, segment.begin, segment.end, segment.level});
    }
  }
  return steps;
}

std::optional<double> error_eq20(const Recording& recording, std::span<const double> simulated, const StepWindow& step,
                                 const Eq20Window& window) {
  if (!covered_samples(recording, step, window)) return std::nullopt;
  const auto count = static_cast<std::size_t>(std::llround(window.rate_hz * window.duration_s));
  const double samples_per_point = 1.0 / (window.rate_hz * recording.sample_period_s);
  const auto& measured = recording.output.values;
  double sum = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double position = static_cast<double>(step.begin) + static_cast<double>(i) * samples_per_point;
    const auto left = std::min(static_cast<std::size_t>(position), measured.size() - 1);
    const std::size_t right = std::min(left + 1, measured.size() - 1);
    const double share = position - static_cast<double>(left);
    const double error_left = measured[left] - simulated[left];
    const double error_right = measured[right] - simulated[right];
    const double error = error_left + share * (error_right - error_left);
    sum += error * error;
  }
  return std::sqrt(sum) / window.duration_s;
}

std::optional<double> settling_error(const Recording& recording, std::span<const double> simulated,
                                     const StepWindow& step, const Eq20Window& window) {
  const auto samples = covered_samples(recording, step, window);
  if (!samples) return std::nullopt;
  const std::size_t from = tail_begin(step, *samples);
  const std::size_t to = step.begin + *samples;
  return std::abs(mean_of(recording.output.values, from, to) - mean_of(simulated, from, to));
}

std::optional<double> measured_rise_time_s(const Recording& recording, const StepWindow& step, const Eq20Window& window,
                                           double noise_rms) {
  constexpr std::size_t kBefore = 10;
  const auto samples = covered_samples(recording, step, window);
  if (!samples || step.begin < kBefore || *samples < 20) return std::nullopt;
  const auto& y = recording.output.values;
  const double low = mean_of(y, step.begin - kBefore, step.begin);
  const double high = mean_of(y, tail_begin(step, *samples), step.begin + *samples);
  if (!(high - low > 10 * noise_rms)) return std::nullopt;

  const auto crossing = [&](double level) -> std::optional<double> {
    double previous = low;
    for (std::size_t i = step.begin; i + 2 < step.begin + *samples; ++i) {
      const double here = median_of_five(y, std::max<std::size_t>(i, 2));
      if (here >= level) {
        const double share = here > previous ? (level - previous) / (here - previous) : 0;
        return static_cast<double>(i) - 1 + share;
      }
      previous = here;
    }
    return std::nullopt;
  };
  const auto ten = crossing(low + 0.1 * (high - low));
  const auto ninety = crossing(low + 0.9 * (high - low));
  if (!ten || !ninety) return std::nullopt;
  return (*ninety - *ten) * recording.sample_period_s;
}

}  // namespace valvetriage
