#include "core/classify/q_values.h"

#include <algorithm>
#include <numeric>

namespace valvetriage {

std::vector<double> q_values(std::span<const double> probabilities) {
  std::vector<std::size_t> order(probabilities.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return probabilities[a] > probabilities[b]; });
  std::vector<double> q(probabilities.size());
  double false_names = 0;
  for (std::size_t first = 0; first < order.size();) {
    std::size_t end = first;
    for (; end < order.size() && probabilities[order[end]] == probabilities[order[first]]; ++end) {
      false_names += 1 - probabilities[order[end]];
    }
    for (; first < end; ++first) q[order[first]] = false_names / static_cast<double>(end);
  }
  return q;
}

double expected_false(std::span<const double> probabilities) {
  return std::accumulate(probabilities.begin(), probabilities.end(), 0.0,
                         [](double sum, double probability) { return sum + 1 - probability; });
}

}  // namespace valvetriage
