#include "core/classify/two_groups.h"

#include <algorithm>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

namespace valvetriage {
namespace {

constexpr std::size_t kFewest = 4;      // with three, no order of ranks is below 5 %
constexpr double kAsLikely = 1 + 1e-7;  // rounding of logarithms

double log_choose(double n, double k) {
  return boost::math::lgamma(n + 1) - boost::math::lgamma(k + 1) - boost::math::lgamma(n - k + 1);
}

}  // namespace

double rank_sum_p_value(std::span<const double> a, std::span<const double> b) {
  if (a.size() < kFewest || b.size() < kFewest) return std::numeric_limits<double>::quiet_NaN();
  std::vector<std::pair<double, bool>> all;
  for (const double value : a) all.emplace_back(value, true);
  for (const double value : b) all.emplace_back(value, false);
  std::sort(all.begin(), all.end());
  const double n = static_cast<double>(all.size());
  double rank_sum = 0, ties = 0;
  for (std::size_t i = 0; i < all.size();) {
    std::size_t end = i;
    while (end < all.size() && all[end].first == all[i].first) ++end;
    const double rank = 0.5 * static_cast<double>(i + 1 + end), equal = static_cast<double>(end - i);
    for (; i < end; ++i) rank_sum += all[i].second ? rank : 0;
    ties += equal * (equal * equal - 1);
  }
  const double na = static_cast<double>(a.size()), nb = static_cast<double>(b.size());
  const double expected = na * (n + 1) / 2;
  const double variance = na * nb / 12 * (n + 1 - ties / (n * (n - 1)));
  if (variance <= 0) return 1;
  const double z = std::max(0.0, std::abs(rank_sum - expected) - 0.5) / std::sqrt(variance);
  return std::erfc(z / std::sqrt(2.0));
}

double fisher_exact_p_value(std::int64_t a_yes, std::int64_t a_no, std::int64_t b_yes, std::int64_t b_no) {
  const std::int64_t a = a_yes + a_no, b = b_yes + b_no, yes = a_yes + b_yes;
  if (a == 0 || b == 0 || yes == 0 || yes == a + b) return 1;
  const auto as_double = [](std::int64_t count) { return static_cast<double>(count); };
  const double all = log_choose(as_double(a + b), as_double(yes));
  const auto probability = [&](std::int64_t of_a) {
    return std::exp(log_choose(as_double(a), as_double(of_a)) + log_choose(as_double(b), as_double(yes - of_a)) - all);
  };
  const double observed = probability(a_yes) * kAsLikely;
  double p = 0;
  for (std::int64_t k = std::max<std::int64_t>(0, yes - b); k <= std::min(a, yes); ++k) {
    const double chance = probability(k);
    if (chance <= observed) p += chance;
  }
  return std::min(1.0, p);
}

}  // namespace valvetriage
