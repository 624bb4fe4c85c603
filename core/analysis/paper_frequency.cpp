#include "core/analysis/paper_frequency.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace valvetriage {
namespace {

constexpr double kGridReach = 10;  // e-folds
constexpr double kGridStep = 1.0 / 64;

double gain_at(const TransferFunction& g, double omega) {
  const double f = omega / (2 * std::numbers::pi);
  return std::abs(frequency_response(g, {&f, 1})[0]);
}

}  // namespace

double corner_log_gain(double x, double corner, double t) {
  return t * (corner - 0.5 * std::log(std::exp(2 * x) + std::exp(2 * corner)));
}

double corner_log_gain_as_printed(double x, double corner, double t) {
  return t * (corner - 0.5 * std::log(std::exp(2 * x)) + std::exp(2 * corner));
}

double asymptote(double x, double corner, double t) {
  return x <= corner ? 0 : -t * (x - corner);
}

double asymptote_gap(double x, double corner, double t) {
  return 0.5 * t * std::log1p(std::exp(x <= corner ? 2 * (x - corner) : -2 * (x - corner)));
}

CornerFormCheck check_corner_form() {
  constexpr double kCorner = 1.25;
  const TransferFunction lag{.domain = Domain::kS, .poles = {-std::exp(kCorner)}, .gain = std::exp(kCorner)};
  CornerFormCheck check;
  for (double x = kCorner - kGridReach; x <= kCorner + kGridReach; x += kGridStep) {
    for (const double t : {1.0, -1.0}) {
      const double gap = asymptote_gap(x, kCorner, t), line = asymptote(x, kCorner, t);
      const auto widen = [](double& largest, double value) { largest = std::max(largest, std::abs(value)); };
      widen(check.largest_deviation, line - corner_log_gain(x, kCorner, t) - gap);
      widen(check.largest_deviation_as_printed, line - corner_log_gain_as_printed(x, kCorner, t) - gap);
      widen(check.largest_gap, gap);
      widen(check.response_deviation, t * std::log(gain_at(lag, std::exp(x))) - corner_log_gain(x, kCorner, t));
    }
  }
  return check;
}

double half_power_frequency(const TransferFunction& g) {
  const double wanted = std::abs(static_gain(g)) / std::numbers::sqrt2;
  double low = 1e-6, high = low;
  while (gain_at(g, high) > wanted) {
    low = high;
    high *= 1.01;
  }
  for (int halving = 0; halving < 60; ++halving) {
    const double middle = 0.5 * (low + high);
    (gain_at(g, middle) > wanted ? low : high) = middle;
  }
  return low;
}

}  // namespace valvetriage
