#include "core/analysis/paper_error_scaling.h"

#include <cmath>
#include <numbers>

#include "core/residual/step_response.h"

namespace valvetriage {
namespace {

constexpr double kTau_s = 0.1;
constexpr double kTone_hz = 10;  // whole periods in every window

double tone(double t) {
  return std::sin(2 * std::numbers::pi * kTone_hz * t);
}
double settling(double t) {
  return std::exp(-t / kTau_s);
}

double eq20_of(double (*residual)(double), double rate_hz, double duration_s) {
  const auto n = static_cast<std::size_t>(std::lround(rate_hz * duration_s));
  Recording recording;
  recording.sample_period_s = 1 / rate_hz;
  for (std::size_t i = 0; i < n; ++i) {
    recording.output.values.push_back(residual(static_cast<double>(i) * recording.sample_period_s));
  }
  const std::vector<double> simulated(n, 0.0);
  return error_eq20(recording, simulated, {0, 0, n, 0}, {rate_hz, duration_s}).value();
}

}  // namespace

ErrorScaling measure_error_scaling() {
  constexpr double kRate_hz = 1000, kDuration_s = 2;
  const auto by_rate = [](double (*r)(double)) {
    return eq20_of(r, 2 * kRate_hz, kDuration_s) / eq20_of(r, kRate_hz, kDuration_s);
  };
  const auto by_duration = [](double (*r)(double)) {
    return eq20_of(r, kRate_hz, 2 * kDuration_s) / eq20_of(r, kRate_hz, kDuration_s);
  };
  return {by_rate(tone), by_duration(tone), by_rate(settling), by_duration(settling)};
}

}  // namespace valvetriage
