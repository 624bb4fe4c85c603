#include "core/model/test_plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace valvetriage {
namespace {

constexpr double kTwoPi = 2 * std::numbers::pi;
constexpr double kMaxSamples = 10e6;  // 14 hours at 200 Hz: no stand plays longer
constexpr double kSamplesPerCycle = 5;

using Current = std::vector<double>;

Error bad_plan(const std::string& field, const std::string& message) {
  Error error{.code = "bad_plan", .message = message};
  error.field = field;
  return error;
}

bool is_wave(PlannedTest test) {
  return test == PlannedTest::kSweep || test == PlannedTest::kMultisine;
}
bool has_holds(PlannedTest test) {
  return test == PlannedTest::kStep || test == PlannedTest::kStaircase;
}

std::optional<Error> wrong_with(const TestPlan& plan) {
  if (!(plan.sample_rate_hz > 0)) return bad_plan("sample_rate_hz", "the sample rate must be positive");
  if (plan.levels_psi.empty()) return bad_plan("levels_psi", "give at least one level");
  if (plan.test != PlannedTest::kStep && plan.levels_psi.size() < 2) {
    return bad_plan("levels_psi", "this test runs between levels: give at least two");
  }
  const double length_s = has_holds(plan.test) ? plan.hold_s : plan.duration_s;
  if (!(length_s > 0)) return bad_plan(has_holds(plan.test) ? "hold_s" : "duration_s", "the duration must be positive");
  if (!is_wave(plan.test)) return std::nullopt;
  if (!(plan.from_hz > 0) || !(plan.to_hz > plan.from_hz)) {
    return bad_plan("from_hz", "the frequencies must be positive and rise");
  }
  if (plan.to_hz * kSamplesPerCycle > plan.sample_rate_hz) {
    return bad_plan(
        "to_hz", fmt::format("{} Hz needs a sample rate of at least {} Hz", plan.to_hz, plan.to_hz * kSamplesPerCycle));
  }
  return std::nullopt;
}

/// Number of samples that a time takes, at least one.
std::size_t samples_in(double time_s, const TestPlan& plan) {
  return std::max<std::size_t>(1, static_cast<std::size_t>(std::llround(time_s * plan.sample_rate_hz)));
}

Current hold_each(std::span<const double> levels_a, const TestPlan& plan) {
  Current current;
  for (const double level : levels_a) current.insert(current.end(), samples_in(plan.hold_s, plan), level);
  return current;
}

/// Rest, level, rest, level, ... rest; a level that is the rest itself needs no step.
Current steps(std::span<const double> levels_a, const TestPlan& plan, double rest_a) {
  std::vector<double> visits{rest_a};
  for (const double level : levels_a) {
    if (level == rest_a) continue;
    visits.push_back(level);
    visits.push_back(rest_a);
  }
  return hold_each(visits, plan);
}

Current staircase(std::vector<double> levels_a, const TestPlan& plan) {
  std::sort(levels_a.begin(), levels_a.end());
  std::vector<double> visits = levels_a;
  visits.insert(visits.end(), levels_a.rbegin() + 1, levels_a.rend());
  return hold_each(visits, plan);
}

Current triangle(double low_a, double high_a, const TestPlan& plan) {
  Current current(samples_in(plan.duration_s, plan));
  const double half = static_cast<double>(current.size()) / 2;
  for (std::size_t i = 0; i < current.size(); ++i) {
    const double way = 1 - std::abs(static_cast<double>(i) - half) / half;
    current[i] = low_a + (high_a - low_a) * way;
  }
  return current;
}

/// u(t) = mid + A sin(2π f0 L (e^(t/L) − 1)),  L = duration / ln(f1/f0)
Current sweep(double low_a, double high_a, const TestPlan& plan) {
  Current current(samples_in(plan.duration_s, plan));
  const double length_s = plan.duration_s / std::log(plan.to_hz / plan.from_hz);
  for (std::size_t i = 0; i < current.size(); ++i) {
    const double t = static_cast<double>(i) / plan.sample_rate_hz;
    const double phase = kTwoPi * plan.from_hz * length_s * std::expm1(t / length_s);
    current[i] = (low_a + high_a) / 2 + (high_a - low_a) / 2 * std::sin(phase);
  }
  return current;
}

/// u(t) = mid + A Σ cos(2π h t / period + phase_h), h odd within the band, every fourth line left out.
Current multisine(double low_a, double high_a, const TestPlan& plan) {
  Current current(samples_in(plan.duration_s, plan), 0.0);
  const double period_s = plan.duration_s / 2;
  std::mt19937_64 random(plan.seed);
  int line = 0;
  for (int h = 1; h / period_s <= plan.to_hz; h += 2) {
    if (h / period_s < plan.from_hz || ++line % 4 == 0) continue;
    const double phase = kTwoPi * static_cast<double>(random() >> 11) * 0x1p-53;
    for (std::size_t i = 0; i < current.size(); ++i) {
      current[i] += std::cos(kTwoPi * h * static_cast<double>(i) / plan.sample_rate_hz / period_s + phase);
    }
  }
  const auto [least, most] = std::minmax_element(current.begin(), current.end());
  const double lowest = *least, range = *most - *least;
  if (range == 0) return {};  // no line in the band
  for (double& value : current) value = low_a + (high_a - low_a) * (value - lowest) / range;
  return current;
}

double planned_samples(const TestPlan& plan) {
  const double visits = 2 * static_cast<double>(plan.levels_psi.size()) + 1;
  return plan.sample_rate_hz * (has_holds(plan.test) ? plan.hold_s * visits : plan.duration_s);
}

}  // namespace

std::string plan_csv(std::span<const double> input, double sample_rate_hz, bool is_current) {
  fmt::memory_buffer text;
  const auto out = fmt::appender(text);
  fmt::format_to(out, "time_s,{}\n", is_current ? "current_A" : "input");
  for (std::size_t i = 0; i < input.size(); ++i) {
    fmt::format_to(out, "{:.15g},{:.9g}\n", static_cast<double>(i) / sample_rate_hz, input[i]);
  }
  return fmt::to_string(text);
}

StaticMap paper_steady_map() {
  return {.input = {1.2, 1.4, 1.6, 1.8, 2.0}, .output = {3.1, 26, 120, 160, 210}};
}

Result<std::vector<double>> plan_current(const TestPlan& plan, const StaticMap& steady_map) {
  if (auto error = wrong_with(plan)) return tl::unexpected(*error);
  if (!(planned_samples(plan) <= kMaxSamples)) {
    return fail("too_large", fmt::format("the plan has more than {:.0f} samples", kMaxSamples));
  }
  std::vector<double> levels_a;
  for (const double level_psi : plan.levels_psi) {
    const Result<double> level_a = steady_map.inverse(level_psi);
    if (!level_a) {
      return fail("level_out_of_range", fmt::format("{:.6g} psi lies outside the steady map, {:.6g} to {:.6g} psi",
                                                    level_psi, steady_map.output.front(), steady_map.output.back()));
    }
    levels_a.push_back(*level_a);
  }
  const auto [low, high] = std::minmax_element(levels_a.begin(), levels_a.end());
  Current current;
  switch (plan.test) {
    case PlannedTest::kStep:
      current = steps(levels_a, plan, steady_map.input.front());
      break;
    case PlannedTest::kStaircase:
      current = staircase(levels_a, plan);
      break;
    case PlannedTest::kTriangle:
      current = triangle(*low, *high, plan);
      break;
    case PlannedTest::kSweep:
      current = sweep(*low, *high, plan);
      break;
    case PlannedTest::kMultisine:
      current = multisine(*low, *high, plan);
      break;
  }
  if (plan.test == PlannedTest::kStep && current.size() == samples_in(plan.hold_s, plan)) {
    return tl::unexpected(bad_plan("levels_psi", "the only level is the level of rest: there is no step"));
  }
  if (current.empty()) return tl::unexpected(bad_plan("from_hz", "no frequency of the multisine lies in the band"));
  return current;
}

}  // namespace valvetriage
