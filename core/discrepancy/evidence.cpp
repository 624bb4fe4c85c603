#include "core/discrepancy/evidence.h"

#include <algorithm>
#include <array>
#include <boost/math/distributions/fisher_f.hpp>
#include <cmath>
#include <limits>

namespace valvetriage {
namespace {

using Eigen::Index;

constexpr std::array<Index, 4> kBlocks{1, 4, 16, 64};
constexpr Index kGroupBlock = 16;
constexpr int kFewestBlocks = 12;

}  // namespace

double noise_inflation(const Stack& residual) {
  double largest = 1;
  for (const Index length : kBlocks) {
    double squares = 0, samples = 0;
    for (const Eigen::VectorXd& r : residual) {
      for (Index first = 0; first + length <= r.size(); first += length) {
        const double sum = r.segment(first, length).sum();
        squares += sum * sum;
        samples += static_cast<double>(length);
      }
    }
    if (samples > 0) largest = std::max(largest, squares / samples);
  }
  return largest;
}

double good_valve_p_value(double reduction, Index freedoms, double noise_reduction, double good_valve_mean,
                          int good_valves) {
  const double k = static_cast<double>(freedoms);
  const double searched = std::max(0.0, noise_reduction - k);
  const double spread = std::max(0.0, (good_valve_mean - noise_reduction) / k);
  const double scale = 1 + spread;
  const double statistic = (reduction - searched) / (k * scale);
  if (!(statistic > 0)) return 1;
  const double known = spread > 1e-3 ? good_valves * (scale / spread) * (scale / spread) : 1e6;
  return boost::math::cdf(boost::math::complement(boost::math::fisher_f(k, std::min(known, 1e6)), statistic));
}

std::vector<LeftoverGroup> leftover_groups(const LinearisedValve& fit, double output_range) {
  static constexpr std::array<const char*, 6> kNames{"at rest, low",  "at rest, middle", "at rest, high",
                                                     "moving, low", "moving, middle",  "moving, high"};
  std::array<double, 6> squares{};
  std::array<int, 6> blocks{};
  for (std::size_t r = 0; r < fit.error().size(); ++r) {
    const auto& sample = fit.rows()[r].sample;
    const auto& output = fit.run(r).output;
    for (Index first = 0; first + kGroupBlock <= fit.error()[r].size(); first += kGroupBlock) {
      const std::size_t begin = sample[static_cast<std::size_t>(first)];
      const std::size_t end = sample[static_cast<std::size_t>(first + kGroupBlock - 1)];
      const auto [least, most] = std::minmax_element(output.begin() + static_cast<std::ptrdiff_t>(begin),
                                                     output.begin() + static_cast<std::ptrdiff_t>(end) + 1);
      const double level = std::clamp(0.5 * (*least + *most) / output_range, 0.0, 0.999);
      const bool moving = *most - *least > 0.01 * output_range;
      const std::size_t group = static_cast<std::size_t>(3 * level) + (moving ? 3 : 0);
      const double mean = fit.error()[r].segment(first, kGroupBlock).mean();
      squares[group] += mean * mean * static_cast<double>(kGroupBlock);
      ++blocks[group];
    }
  }
  std::vector<LeftoverGroup> groups;
  for (std::size_t g = 0; g < squares.size(); ++g) {
    LeftoverGroup group{.group = kNames[g], .log_ratio = std::numeric_limits<double>::quiet_NaN(), .blocks = blocks[g]};
    if (blocks[g] >= kFewestBlocks) group.log_ratio = std::log(std::max(squares[g] / blocks[g], 1e-12));
    groups.push_back(std::move(group));
  }
  return groups;
}

}  // namespace valvetriage
