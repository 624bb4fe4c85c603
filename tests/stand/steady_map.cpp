#include "tests/stand/steady_map.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace valvetriage::stand {
namespace {

constexpr std::array<double, 10> kCurrentA = {0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.2, 2.4};
constexpr std::array<double, 10> kPressurePsi = {0.15, 0.35, 0.84, 3.1, 26.0, 120.0, 160.0, 210.0, 240.0, 256.0};
using Levels = std::array<double, 10>;

/// Slopes of the monotone cubic (Fritsch and Butland 1984, equal spacing).
Levels monotone_slopes(const Levels& y, double spacing) {
  Levels slope{};
  for (std::size_t i = 1; i + 1 < y.size(); ++i) {
    const double left = (y[i] - y[i - 1]) / spacing, right = (y[i + 1] - y[i]) / spacing;
    slope[i] = 2 * left * right / (left + right);
  }
  slope.front() = (y[1] - y[0]) / spacing;
  slope.back() = (y[y.size() - 1] - y[y.size() - 2]) / spacing;
  return slope;
}

double hermite(double y0, double y1, double slope0, double slope1, double step, double fraction) {
  const double s = fraction, s2 = s * s, s3 = s2 * s;
  return (2 * s3 - 3 * s2 + 1) * y0 + (3 * s2 - 2 * s3) * y1 + step * ((s3 - 2 * s2 + s) * slope0 + (s3 - s2) * slope1);
}

double through_levels(const Levels& y, const Levels& slope, double current_a) {
  const double spacing = kCurrentA[1] - kCurrentA[0];
  const double position = (current_a - kCurrentA[0]) / spacing;
  const auto i = static_cast<std::size_t>(std::clamp(std::floor(position), 0.0, 8.0));
  const double fraction = position - static_cast<double>(i);
  if (fraction < 0) return y.front() + slope.front() * spacing * fraction;
  if (fraction > 1) return y.back() + slope.back() * spacing * (fraction - 1);
  return hermite(y[i], y[i + 1], slope[i], slope[i + 1], spacing, fraction);
}

double smoothed(const Levels& y, const Levels& slope, double current_a) {
  constexpr double kSmoothingA = 0.025;
  double sum = 0, weights = 0;
  for (int j = -12; j <= 12; ++j) {
    const double z = j / 4.0, weight = std::exp(-0.5 * z * z);
    sum += weight * through_levels(y, slope, current_a + z * kSmoothingA);
    weights += weight;
  }
  return sum / weights;
}

Curve make_nominal() {
  // Smoothing pulls the curve off the levels; the knots are moved until it passes through them again.
  Levels y = kPressurePsi;
  Levels slope = monotone_slopes(y, 0.2);
  for (int pass = 0; pass < 40; ++pass) {
    for (std::size_t i = 0; i < y.size(); ++i) y[i] += kPressurePsi[i] - smoothed(y, slope, kCurrentA[i]);
    slope = monotone_slopes(y, 0.2);
  }
  return {0.6, 2.4, 721, [&](double a) { return smoothed(y, slope, a); }};
}

}  // namespace

Curve::Curve(double low, double high, int knots, const std::function<double(double)>& f)
    : low_(low), step_((high - low) / (knots - 1)) {
  const auto n = static_cast<std::size_t>(knots);
  value_.resize(n);
  slope_.resize(n);
  for (std::size_t i = 0; i < n; ++i) value_[i] = f(low + step_ * static_cast<double>(i));
  for (std::size_t i = 1; i + 1 < n; ++i) slope_[i] = (value_[i + 1] - value_[i - 1]) / (2 * step_);
  slope_.front() = (value_[1] - value_[0]) / step_;
  slope_.back() = (value_[n - 1] - value_[n - 2]) / step_;
}

double Curve::operator()(double x) const {
  const double position = (x - low_) / step_;
  const double last = static_cast<double>(value_.size() - 1);
  if (position <= 0) return value_.front() + slope_.front() * (x - low_);
  if (position >= last) return value_.back() + slope_.back() * step_ * (position - last);
  const auto i = static_cast<std::size_t>(position);
  return hermite(value_[i], value_[i + 1], slope_[i], slope_[i + 1], step_, position - static_cast<double>(i));
}

const Curve& nominal_steady_pressure_psi() {
  static const Curve curve = make_nominal();
  return curve;
}

}  // namespace valvetriage::stand
