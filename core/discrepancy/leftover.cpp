#include "core/discrepancy/leftover.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>

#include "core/discrepancy/evidence.h"
#include "core/residual/noise_floor.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::Index;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr Index kGroupBlock = 16;
constexpr int kFewestBlocks = 12;
constexpr const char* kAtRest = "at rest";

/// Whether a group is slower than good valves', its logarithm as a normal deviate. `own`: standard error of that.
Unusual in_its_logarithm(double log_ratio, double own, int blocks, const LeftoverOnGoodValves& good, int valves) {
  const double between = good.sd * good.sd, within = own * own;
  const double t = (log_ratio - good.mean) / std::sqrt((between + within) * (1 + 1.0 / valves));
  // Freedoms of a sum of variances: Satterthwaite, Biometrics Bulletin 2 (1946) 110.
  const double freedoms = std::pow(between + within, 2) / (between * between / (valves - 1) + within * within / blocks);
  return {t, student_t_upper_tail(freedoms, t)};
}

/// The same of what is slow beyond noise, a square.
double p_value_of_amplitude(double log_ratio, double own, const LeftoverOnGoodValves& good, int valves) {
  const double slow = std::expm1(log_ratio) - own;
  if (!(slow > 0)) return 1;
  const double usual = std::max(0.0, std::expm1(good.mean));
  const double error = own / std::sqrt(static_cast<double>(valves));
  return square_p_value(slow / (usual + error), usual, std::exp(good.mean) * good.sd, valves);
}

}  // namespace

Unusual slower_than_good_valves(double log_ratio, int blocks, const LeftoverOnGoodValves& good, int valves) {
  const double own = std::sqrt(2.0 / blocks);
  Unusual unusual = in_its_logarithm(log_ratio, own, blocks, good, valves);
  unusual.p_value = std::max(unusual.p_value, p_value_of_amplitude(log_ratio, own, good, valves));
  return unusual;
}

std::vector<LeftoverGroup> leftover_groups(const LinearisedValve& fit, double output_range) {
  static constexpr std::array<const char*, 6> kNames{"at rest, low", "at rest, middle", "at rest, high",
                                                     "moving, low",  "moving, middle",  "moving, high"};
  std::array<double, 6> squares{}, fast{}, all{};
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
      const auto block = fit.error()[r].segment(first, kGroupBlock);
      const double mean = block.mean();
      squares[group] += mean * mean * static_cast<double>(kGroupBlock);
      fast[group] += 0.5 * (block.tail(kGroupBlock - 1) - block.head(kGroupBlock - 1)).squaredNorm() /
                     static_cast<double>(kGroupBlock - 1);
      all[group] += block.squaredNorm();
      ++blocks[group];
    }
  }
  std::vector<LeftoverGroup> groups;
  for (std::size_t g = 0; g < squares.size(); ++g) {
    LeftoverGroup group{.group = kNames[g], .log_ratio = std::numeric_limits<double>::quiet_NaN()};
    group.blocks = blocks[g];
    if (blocks[g] > 0) group.mean_square = all[g] / static_cast<double>(blocks[g] * kGroupBlock);
    if (blocks[g] >= kFewestBlocks) group.log_ratio = std::log(std::max(squares[g], 1e-12) / std::max(fast[g], 1e-12));
    groups.push_back(std::move(group));
  }
  const double base = std::max(groups.front().log_ratio, 0.0);  // NaN: 0
  for (LeftoverGroup& group : groups) {
    group.own_log_ratio = group.log_ratio;
    group.log_ratio -= base;
  }
  return groups;
}

Leftover leftover_of(const LinearisedValve& linear, const ValveDiagnosisOptions& options) {
  Leftover leftover;
  double smallest = 1;
  int groups = 0;
  const std::vector<LeftoverGroup> all_groups = leftover_groups(linear, 2 * options.fit.reference_psi);
  const auto on_good_valves = [&](const LeftoverGroup& group) {
    return std::find_if(options.leftovers.begin(), options.leftovers.end(),
                        [&](const LeftoverOnGoodValves& g) { return g.group == group.group; });
  };
  const LeftoverGroup& at_rest = all_groups.front();
  for (const LeftoverGroup& group : all_groups) {
    if (group.group.starts_with(kAtRest)) leftover.at_rest = std::max(leftover.at_rest, group.mean_square);
  }
  if (std::isfinite(at_rest.own_log_ratio)) {
    // Slow noise of the stand itself is there in good valves as well.
    const auto good = on_good_valves(at_rest);
    const double usual = good == options.leftovers.end() ? 0 : good->mean;
    const double between = good == options.leftovers.end() ? 0 : good->sd;
    leftover.at_rest_deviations =
        (at_rest.own_log_ratio - usual) / std::hypot(between, std::sqrt(2.0 / at_rest.blocks));
    leftover.slow_at_rest = (std::exp(at_rest.own_log_ratio) - std::exp(usual)) / static_cast<double>(kGroupBlock);
  }
  for (const LeftoverGroup& group : std::span(all_groups).subspan(1)) {
    const auto good = on_good_valves(group);
    if (!std::isfinite(group.log_ratio) || good == options.leftovers.end()) continue;
    const int valves = good->valves.value_or(options.good_valves);
    if (valves < 2) continue;
    ++groups;
    const auto [t, p] = slower_than_good_valves(group.log_ratio, group.blocks, *good, valves);
    if (p < 0.01) {
      leftover.findings.push_back({.what = "more slow residual than any good valve leaves",
                                   .where = group.group,
                                   .statistic = t,
                                   .p_value = p,
                                   .share_of_structured_residual = kUnknown});
    }
    smallest = std::min(smallest, p);
  }
  leftover.p_value = groups > 0 ? std::min(1.0, smallest * groups) : 1;
  return leftover;
}

double noise_cost(const Explanation& explanation) {
  const ValveFitProblem& problem = *explanation.problem;
  double cost = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    // What a disturbance adds to a recording that stands still counted as its noise until it was explained.
    Recording left = problem.recording(r);
    const std::vector<double> simulated = problem.simulate(explanation.v, r);
    for (std::size_t i = 0; i < simulated.size(); ++i) left.output.values[i] -= simulated[i];
    const double variance = std::pow(noise_floor(left).rms, 2) * problem.inverse_variance(r);
    cost += static_cast<double>(left.valid_samples()) * std::min(variance, 1.0);
  }
  return std::min(cost, explanation.cost);
}

}  // namespace valvetriage
