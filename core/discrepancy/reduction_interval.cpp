#include "core/discrepancy/reduction_interval.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace valvetriage {
namespace {

/// Over the groups that `chosen` tells.
double reduction_over(std::span<const HeldOutSquares> groups, std::span<const std::size_t> chosen) {
  double baseline = 0, extended = 0;
  for (const std::size_t group : chosen) {
    baseline += groups[group].baseline;
    extended += groups[group].extended;
  }
  return baseline > 0 ? 1 - std::sqrt(extended / baseline) : 0;
}

}  // namespace

std::array<double, 2> reduction_interval(std::span<const HeldOutSquares> groups) {
  constexpr std::size_t kDraws = 400, kTail = kDraws / 40;
  std::mt19937_64 random(groups.size());
  std::vector<double> reductions;
  std::vector<std::size_t> chosen(groups.size());
  for (std::size_t draw = 0; draw < kDraws; ++draw) {
    for (std::size_t& group : chosen) group = random() % groups.size();
    reductions.push_back(reduction_over(groups, chosen));
  }
  std::sort(reductions.begin(), reductions.end());
  return {reductions[kTail], reductions[kDraws - 1 - kTail]};
}

}  // namespace valvetriage
