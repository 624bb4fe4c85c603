#include "core/model/static_map.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>

namespace valvetriage {
namespace {

// The piece an input lies in; the first or last one beyond the ends.
std::size_t piece_of(const std::vector<double>& knots, double u) {
  const auto above = std::upper_bound(knots.begin() + 1, knots.end() - 1, u);
  return static_cast<std::size_t>(above - knots.begin()) - 1;
}

double slope_of(const StaticMap& map, std::size_t piece) {
  return (map.output[piece + 1] - map.output[piece]) / (map.input[piece + 1] - map.input[piece]);
}

struct Pool {
  double mean, weight;
  std::size_t count;
};

}  // namespace

double StaticMap::operator()(double u) const {
  const std::size_t i = piece_of(input, u);
  return output[i] + slope_of(*this, i) * (u - input[i]);
}

void StaticMap::apply(std::span<double> signal) const {
  std::size_t i = 0;
  double slope_here = slope_of(*this, i);
  const auto on_piece = [&](double u) {
    return (i == 0 || u >= input[i]) && (i + 2 == input.size() || u < input[i + 1]);
  };
  for (double& u : signal) {
    if (!on_piece(u)) {
      // The next sample of a curve lies on the next piece.
      if (i + 2 < input.size() && u >= input[i + 1]) ++i;
      if (!on_piece(u)) i = piece_of(input, u);
      slope_here = slope_of(*this, i);
    }
    u = output[i] + slope_here * (u - input[i]);
  }
}

double StaticMap::slope(double u) const {
  return slope_of(*this, piece_of(input, u));
}

Result<double> StaticMap::inverse(double y) const {
  const bool rising = output.back() >= output.front();
  const double low = rising ? output.front() : output.back(), high = rising ? output.back() : output.front();
  if (!(y >= low && y <= high)) {
    return fail("outside_map", fmt::format("the output {} is outside the map's range of {} to {}", y, low, high));
  }
  const auto reached = std::find_if(output.begin(), output.end(), [&](double v) { return rising ? v >= y : v <= y; });
  const auto i = static_cast<std::size_t>(reached - output.begin());
  if (i == 0) return input.front();
  return input[i - 1] + (y - output[i - 1]) / slope_of(*this, i - 1);
}

std::vector<double> monotone_regression(std::span<const double> values, std::span<const double> weights) {
  std::vector<Pool> pools;
  pools.reserve(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    pools.push_back({values[i], weights.empty() ? 1.0 : weights[i], 1});
    while (pools.size() > 1 && pools[pools.size() - 2].mean > pools.back().mean) {
      const Pool last = pools.back();
      pools.pop_back();
      Pool& pool = pools.back();
      const double weight = pool.weight + last.weight;
      // Samples without weight follow their neighbours.
      pool.mean = weight > 0 ? (pool.weight * pool.mean + last.weight * last.mean) / weight : last.mean;
      pool.weight = weight;
      pool.count += last.count;
    }
  }
  std::vector<double> fitted;
  fitted.reserve(values.size());
  for (const Pool& pool : pools) fitted.insert(fitted.end(), pool.count, pool.mean);
  return fitted;
}

}  // namespace valvetriage
