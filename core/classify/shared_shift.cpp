#include "core/classify/shared_shift.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

constexpr double kTrimmed = 0.2;  // at each end: Yuen's choice

/// Mean of a lot that its odd valves do not move, and its uncertainty.
struct TrimmedMean {
  double mean = 0, squared_error = 0, freedoms = 0;
};

TrimmedMean trimmed_mean(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto n = static_cast<double>(values.size());
  const auto cut = static_cast<std::ptrdiff_t>(kTrimmed * n);
  const auto first = values.begin() + cut, last = values.end() - cut;
  const double kept = n - 2 * static_cast<double>(cut);
  TrimmedMean trimmed{.mean = std::accumulate(first, last, 0.0) / kept};
  std::fill(values.begin(), first, *first);
  std::fill(last, values.end(), *(last - 1));
  const double centre = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double squares = 0;
  for (const double value : values) squares += (value - centre) * (value - centre);
  trimmed.squared_error = squares / (kept * (kept - 1));
  trimmed.freedoms = kept - 1;
  return trimmed;
}

}  // namespace

std::optional<SharedShift> shared_shift(std::span<const double> values, const GoodValves& good) {
  if (values.size() < static_cast<std::size_t>(kFewestShiftValves) || good.valves < 2) return std::nullopt;
  TrimmedMean lot = trimmed_mean({values.begin(), values.end()});
  const double n = good.valves;
  const double of_good = good.sd * good.sd / n;
  const double of_as_many_good = good.sd * good.sd / static_cast<double>(values.size());
  lot.squared_error = std::max(lot.squared_error, of_as_many_good);
  const double squared_error = lot.squared_error + of_good;
  if (!(squared_error > 0) || !(good.sd > 0)) return std::nullopt;
  SharedShift found{.shift = lot.mean - good.mean, .std_error = std::sqrt(squared_error)};
  const double welch = squared_error * squared_error /
                       (lot.squared_error * lot.squared_error / lot.freedoms + of_good * of_good / (n - 1));
  found.degrees_of_freedom = std::min(welch, n - 1);
  const double half = found.std_error * student_t_half_width95(found.degrees_of_freedom);
  found.ci95 = {found.shift - half, found.shift + half};
  found.p_value = 2 * student_t_upper_tail(found.degrees_of_freedom, std::abs(found.shift) / found.std_error);
  for (const double value : values) {
    const double deviation = std::abs(value - good.mean) / (good.sd * std::sqrt(1 + 1 / n));
    found.largest_single = std::max(found.largest_single, deviation);
  }
  return found;
}

std::vector<double> holm_adjusted(std::span<const double> p_values) {
  std::vector<std::size_t> order(p_values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return p_values[a] < p_values[b]; });
  std::vector<double> adjusted(p_values.size());
  double largest = 0;
  for (std::size_t rank = 0; rank < order.size(); ++rank) {
    largest = std::max(largest, static_cast<double>(order.size() - rank) * p_values[order[rank]]);
    adjusted[order[rank]] = std::min(1.0, largest);
  }
  return adjusted;
}

}  // namespace valvetriage
