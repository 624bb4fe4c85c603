#include "core/model/magnetic_loop.h"

#include <algorithm>
#include <cmath>

#include "core/recording/white_noise.h"

namespace valvetriage {
namespace {

constexpr double kGateInDeviations = 1.0;

}  // namespace

double loop_gate(const IntervalSignal& input) {
  return kGateInDeviations * (input.noise ? *input.noise : white_noise(input.start));
}

std::vector<double> loop_driver(const IntervalSignal& input, double gate) {
  std::vector<double> driver(input.start.size());
  double at = input.start.empty() ? 0 : input.start.front();
  for (std::size_t i = 0; i < driver.size(); ++i) {
    at = std::clamp(at, input.start[i] - gate, input.start[i] + gate);
    driver[i] = at;
  }
  return driver;
}

IntervalSignal MagneticLoop::apply(const IntervalSignal& input, std::span<const double> driver) const {
  IntervalSignal x = input;
  if (width_a == 0) return x;
  const auto thresholds = thresholds_a();
  std::array<double, kThresholds_a.size()> stop{};
  for (std::size_t k = 0; k < stop.size(); ++k) stop[k] = memory * thresholds[k];
  std::array<double, kThresholds_a.size()> slope{};
  for (std::size_t k = 0; k < slope.size(); ++k) slope[k] = 0.5 * width_a * shares[k] / thresholds[k];
  double previous = driver.empty() ? 0 : driver.front();
  const std::size_t n = input.start.size();
  double held_back = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double move = driver[i] - previous;
    previous = driver[i];
    held_back = 0;
    for (std::size_t k = 0; k < stop.size(); ++k) {
      stop[k] = std::clamp(stop[k] + move, -thresholds[k], thresholds[k]);
      held_back += slope[k] * stop[k];
    }
    x.start[i] -= held_back;
    // A ramp ends where the next sample starts; a held command ends as it began.
    if (i > 0 && input.end[i - 1] == input.start[i]) x.end[i - 1] = x.start[i];
    x.end[i] -= held_back;
  }
  return x;
}

}  // namespace valvetriage
