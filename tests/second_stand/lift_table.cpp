#include "tests/second_stand/lift_table.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace valvetriage::second_stand {
namespace {

/// Steffen's slope from the secants on both sides.
double slope_between(double before, double after) {
  if (before * after <= 0) return 0;
  return std::copysign(2, before) * std::min({std::abs(before), std::abs(after), 0.25 * std::abs(before + after)});
}

}  // namespace

LiftTable::LiftTable(double first_mm, double last_mm, std::vector<double> values)
    : first_mm_(first_mm),
      spacing_mm_((last_mm - first_mm) / static_cast<double>(values.size() - 1)),
      value_(std::move(values)),
      slope_(value_.size()) {
  const auto secant = [&](std::size_t k) { return value_[k + 1] - value_[k]; };
  slope_.front() = secant(0);
  slope_.back() = secant(value_.size() - 2);
  for (std::size_t k = 1; k + 1 < value_.size(); ++k) slope_[k] = slope_between(secant(k - 1), secant(k));
}

double LiftTable::operator()(double lift_mm) const {
  const double place = (lift_mm - first_mm_) / spacing_mm_;
  if (place <= 0) return value_.front();
  const auto k = static_cast<std::size_t>(place);
  if (k + 1 >= value_.size()) return value_.back();
  const double s = place - static_cast<double>(k), rise = value_[k + 1] - value_[k];
  const double bend = slope_[k] + slope_[k + 1] - 2 * rise;
  return value_[k] + s * (slope_[k] + s * (3 * rise - 2 * slope_[k] - slope_[k + 1] + s * bend));
}

double LiftTable::lift_of(double value) const {
  double low = first_mm_, high = lift_mm(value_.size() - 1);
  for (int halving = 0; halving < 60; ++halving) {
    const double middle = 0.5 * (low + high);
    ((*this)(middle) < value ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace valvetriage::second_stand
