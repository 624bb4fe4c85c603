#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/model/linear_filter.h"
#include "core/model/transfer_function.h"

namespace valvetriage {
namespace {

constexpr double kSettlingBand = 0.02;
constexpr double kRiseFrom = 0.1, kRiseTo = 0.9;

// A continuous response is sampled this finely over the stretch of interest: the times are read to 1/2000 of it.
constexpr std::size_t kSamples = 2000;
// Each pass looks at a stretch of the response; a stiff system needs a few to go from its slowest pole to its rise.
constexpr int kMaxPasses = 60;
// The longest discrete step response that is followed: 16 hours at 200 Hz.
constexpr std::size_t kMaxDiscreteSamples = 12'000'000;
// A pole forgets to exp(−24) of its start, far below the settling band, also where a few poles coincide.
constexpr double kForgottenTimeConstants = 24;

/// Step response normalised to end at 1.
struct Response {
  std::vector<double> y;
  double period_s;
};

Result<Response> respond(const LinearFilter& filter, double gain, std::size_t samples, double period_s) {
  const std::vector<double> step(samples, 1.0);
  Response response{std::vector<double>(samples), period_s};
  FilterState state = filter.rest();
  filter.run(state, step, step, response.y);
  for (double& y : response.y) y /= gain;
  return response;
}

// First time the response reaches a level, linear between samples; the end where it never does.
double time_to(const Response& r, double level) {
  const auto reached = std::find_if(r.y.begin(), r.y.end(), [&](double y) { return y >= level; });
  const auto i = static_cast<std::size_t>(reached - r.y.begin());
  if (i == 0 || i == r.y.size()) return static_cast<double>(i) * r.period_s;
  const double part = (level - r.y[i - 1]) / (r.y[i] - r.y[i - 1]);
  return (static_cast<double>(i - 1) + part) * r.period_s;
}

// When the response enters the band for good, linear between samples.
double settling_time(const Response& r) {
  std::size_t i = r.y.size();
  while (i > 0 && std::abs(r.y[i - 1] - 1) <= kSettlingBand) --i;
  if (i == 0 || i == r.y.size()) return static_cast<double>(i) * r.period_s;
  const double edge = r.y[i - 1] > 1 ? 1 + kSettlingBand : 1 - kSettlingBand;
  const double part = (edge - r.y[i - 1]) / (r.y[i] - r.y[i - 1]);
  return (static_cast<double>(i - 1) + std::clamp(part, 0.0, 1.0)) * r.period_s;
}

StepMetrics metrics_of(const Response& r) {
  const double highest = *std::max_element(r.y.begin(), r.y.end());
  return {.rise_time_s = time_to(r, kRiseTo) - time_to(r, kRiseFrom),
          .settling_time_s = settling_time(r),
          .overshoot_ratio = std::max(0.0, highest - 1)};
}

Result<StepMetrics> discrete_metrics(const TransferFunction& g, double gain) {
  const auto filter = LinearFilter::recursion(g);
  if (!filter) return tl::unexpected(filter.error());
  double slowest = 0;
  for (const auto& p : g.poles) slowest = std::max(slowest, std::abs(p));
  const double memory = slowest > 0 ? kForgottenTimeConstants / -std::log(slowest) : 0;
  const double samples = memory + static_cast<double>(g.poles.size() + filter->delay_samples()) + 2;
  if (samples > static_cast<double>(kMaxDiscreteSamples)) {
    return fail("too_slow", fmt::format("the model's slowest pole has modulus {:.9f}: its step response is too long to "
                                        "follow",
                                        slowest));
  }
  const auto response = respond(*filter, gain, static_cast<std::size_t>(samples), g.sample_time_s);
  if (!response) return tl::unexpected(response.error());
  return metrics_of(*response);
}

Result<Response> continuous_response(const TransferFunction& g, double gain, double horizon_s) {
  const double period_s = horizon_s / kSamples;
  const auto filter = LinearFilter::sampled(g, period_s);
  if (!filter) return tl::unexpected(filter.error());
  return respond(*filter, gain, kSamples + 1, period_s);
}

// The slowest pole gives the horizon, which shrinks to where things happen.
Result<StepMetrics> continuous_metrics(const TransferFunction& g, double gain) {
  double slowest = std::numeric_limits<double>::infinity();
  for (const auto& p : g.poles) slowest = std::min(slowest, -p.real());
  if (g.poles.empty()) return StepMetrics{.rise_time_s = 0, .settling_time_s = g.delay_s, .overshoot_ratio = 0};
  double horizon_s = g.delay_s + kForgottenTimeConstants / slowest;
  auto response = continuous_response(g, gain, horizon_s);
  if (!response) return tl::unexpected(response.error());
  StepMetrics metrics = metrics_of(*response);
  const double settled_s = metrics.settling_time_s;
  for (int pass = 0; pass < kMaxPasses; ++pass) {
    // Rise and overshoot are over before the response settles; look closer until the 90 % point is well resolved.
    const double closer_s = 2 * std::max(time_to(*response, kRiseTo), horizon_s / kSamples);
    if (closer_s > 0.4 * horizon_s) break;
    horizon_s = closer_s;
    response = continuous_response(g, gain, horizon_s);
    if (!response) return tl::unexpected(response.error());
    const StepMetrics close = metrics_of(*response);
    metrics.rise_time_s = close.rise_time_s;
    metrics.overshoot_ratio = std::max(metrics.overshoot_ratio, close.overshoot_ratio);
  }
  const auto settling = continuous_response(g, gain, std::max(1.25 * settled_s, horizon_s / kSamples));
  if (!settling) return tl::unexpected(settling.error());
  metrics.settling_time_s = settling_time(*settling);
  metrics.overshoot_ratio = std::max(metrics.overshoot_ratio, metrics_of(*settling).overshoot_ratio);
  return metrics;
}

}  // namespace

Result<StepMetrics> step_metrics(const TransferFunction& g) {
  if (!is_stable(g)) return fail("unstable", "the model is unstable: its step response does not settle");
  const double gain = static_gain(g);
  if (gain == 0 || !std::isfinite(gain)) {
    return fail("no_static_gain", "the model's static gain is zero: its step response has no level to rise to");
  }
  return g.domain == Domain::kZ ? discrete_metrics(g, gain) : continuous_metrics(g, gain);
}

}  // namespace valvetriage
