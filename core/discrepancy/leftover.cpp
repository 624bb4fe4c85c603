#include "core/discrepancy/leftover.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>

#include "core/discrepancy/evidence.h"
#include "core/discrepancy/unnamed_direction.h"
#include "core/residual/noise_floor.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::Index;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
constexpr Index kGroupBlock = 16;
constexpr int kFewestBlocks = 12;
constexpr const char* kAtRest = "at rest";
constexpr const char* kAboveNoise = "above the noise";
// A stretch of a free run within this share of the range is a rest: what it settles by there is less than noise.
constexpr double kRestRange = 0.002;
constexpr double kShortestRest_s = 0.5;
constexpr std::size_t kFewestAtRest = 64;
constexpr int kFewestRests = 8;
constexpr double kWorthAFinding = 0.01;

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

/// Variance of the noise from sample to sample.
double fast_variance(const Eigen::Ref<const Eigen::VectorXd>& error) {
  const Index steps = error.size() - 1;
  return 0.5 * (error.tail(steps) - error.head(steps)).squaredNorm() / static_cast<double>(steps);
}

/// Mean squares over rests, in noise variances.
struct RestLevels {
  double between = 0;  ///< of a rest's mean residual
  double within = 0;   ///< of half the difference between its halves: all that slow noise leaves in a mean as well
  double fast = 0;     ///< of the noise from sample to sample: 1, less where a coarse reading hides it
  int rests = 0;
};

void add_rest(const Eigen::Ref<const Eigen::VectorXd>& error, RestLevels& levels) {
  const Index half = error.size() / 2;
  const double first = error.head(half).mean(), second = error.tail(half).mean();
  levels.between += 0.25 * (first + second) * (first + second);
  levels.within += 0.25 * (first - second) * (first - second);
  levels.fast += fast_variance(error);
  ++levels.rests;
}

RestLevels rest_levels(const LinearisedValve& fit, const Stack& residual, double output_range) {
  RestLevels levels;
  for (std::size_t r = 0; r < residual.size(); ++r) {
    const auto& sample = fit.rows()[r].sample;
    const std::vector<double>& output = fit.run(r).output;
    const double per_s = 1 / fit.problem().recording(r).sample_period_s;
    const auto shortest = std::max(kFewestAtRest, static_cast<std::size_t>(kShortestRest_s * per_s));
    std::size_t first = 0;
    double least = 0, most = 0;
    for (std::size_t i = 0; i <= sample.size(); ++i) {
      if (i < sample.size() && i > first) {
        least = std::min(least, output[sample[i]]);
        most = std::max(most, output[sample[i]]);
        if (most - least < kRestRange * output_range) continue;
      }
      if (i - first >= shortest) {
        add_rest(residual[r].segment(static_cast<Index>(first), static_cast<Index>(i - first)), levels);
      }
      first = i;
      if (i < sample.size()) least = most = output[sample[i]];
    }
  }
  for (double* mean : {&levels.between, &levels.within, &levels.fast}) *mean /= std::max(levels.rests, 1);
  return levels;
}

/// How much more rests differ from each other than slow noise, or the steps of a coarse reading, would make them.
LeftoverGroup of_rests(const LinearisedValve& fit, const Stack& residual, double output_range) {
  const RestLevels levels = rest_levels(fit, residual, output_range);
  LeftoverGroup group{.group = "from rest to rest", .log_ratio = kUnknown, .blocks = levels.rests};
  if (levels.rests < kFewestRests) return group;
  group.mean_square = levels.between;
  group.log_ratio =
      std::log(std::max(levels.between, 1e-12) / (levels.within + std::max(1.0 / kGroupBlock, 1 - levels.fast)));
  group.own_log_ratio = group.log_ratio;
  return group;
}

const LeftoverOnGoodValves* on_good_valves(const std::string& name, const ValveDiagnosisOptions& options) {
  const auto found = std::find_if(options.leftovers.begin(), options.leftovers.end(),
                                  [&](const LeftoverOnGoodValves& good) { return good.group == name; });
  return found == options.leftovers.end() ? nullptr : &*found;
}

/// What good valves show of it, and how many of them.
struct GoodValves {
  const LeftoverOnGoodValves& leftover;
  int valves = 0;
};

/// None where a scatter is not known.
std::optional<GoodValves> good_valves(const std::string& name, const ValveDiagnosisOptions& options) {
  const LeftoverOnGoodValves* leftover = on_good_valves(name, options);
  if (!leftover) return std::nullopt;
  const int valves = leftover->valves.value_or(options.good_valves);
  return valves < 2 ? std::nullopt : std::optional(GoodValves{*leftover, valves});
}

Finding left_more(const std::string& where, double statistic, double p_value) {
  return {.what = "more slow residual than any good valve leaves",
          .where = where,
          .statistic = statistic,
          .p_value = p_value,
          .share_of_structured_residual = kUnknown};
}

/// The rarest of several looks at one residual.
struct Rarest {
  std::vector<Finding> findings;
  double smallest = 1;
  int looks = 0;

  void add(double p) {
    smallest = std::min(smallest, p);
    ++looks;
  }
  double p_value() const { return looks > 0 ? std::min(1.0, smallest * looks) : 1; }
};

/// Over all groups but the one that the others are measured against.
Rarest rarest_group(std::span<const LeftoverGroup> groups, const ValveDiagnosisOptions& options) {
  Rarest rarest;
  for (const LeftoverGroup& group : groups.subspan(1)) {
    const std::optional<GoodValves> good = good_valves(group.group, options);
    if (!good || !std::isfinite(group.log_ratio)) continue;
    const auto [t, p] = slower_than_good_valves(group.log_ratio, group.blocks, good->leftover, good->valves);
    rarest.add(p);
    if (p < kWorthAFinding) rarest.findings.push_back(left_more(group.group, t, p));
  }
  return rarest;
}

}  // namespace

Unusual slower_than_good_valves(double log_ratio, int blocks, const LeftoverOnGoodValves& good, int valves) {
  const double own = std::sqrt(2.0 / blocks);
  Unusual unusual = in_its_logarithm(log_ratio, own, blocks, good, valves);
  unusual.p_value = std::max(unusual.p_value, p_value_of_amplitude(log_ratio, own, good, valves));
  return unusual;
}

std::vector<LeftoverGroup> leftover_groups(const LinearisedValve& fit, const Stack& residual, double output_range) {
  static constexpr std::array<const char*, 6> kNames{"at rest, low", "at rest, middle", "at rest, high",
                                                     "moving, low",  "moving, middle",  "moving, high"};
  std::array<double, 6> squares{}, fast{}, all{};
  std::array<int, 6> blocks{};
  for (std::size_t r = 0; r < residual.size(); ++r) {
    const auto& sample = fit.rows()[r].sample;
    const auto& output = fit.run(r).output;
    for (Index first = 0; first + kGroupBlock <= residual[r].size(); first += kGroupBlock) {
      const std::size_t begin = sample[static_cast<std::size_t>(first)];
      const std::size_t end = sample[static_cast<std::size_t>(first + kGroupBlock - 1)];
      const auto [least, most] = std::minmax_element(output.begin() + static_cast<std::ptrdiff_t>(begin),
                                                     output.begin() + static_cast<std::ptrdiff_t>(end) + 1);
      const double level = std::clamp(0.5 * (*least + *most) / output_range, 0.0, 0.999);
      const bool moving = *most - *least > 0.01 * output_range;
      const std::size_t group = static_cast<std::size_t>(3 * level) + (moving ? 3 : 0);
      const auto block = residual[r].segment(first, kGroupBlock);
      const double mean = block.mean();
      squares[group] += mean * mean * static_cast<double>(kGroupBlock);
      fast[group] += fast_variance(block);
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
  groups.push_back(of_rests(fit, residual, output_range));
  return groups;
}

std::vector<std::pair<std::string, double>> leftovers_of_good_valve(const LinearisedValve& linear,
                                                                    const Explanation& explanation) {
  std::vector<std::pair<std::string, double>> seen;
  const auto add = [&](const std::string& name, double value) {
    if (std::isfinite(value)) seen.emplace_back(name, value);
  };
  const std::vector<LeftoverGroup> groups =
      leftover_groups(linear, linear.error(), 2 * explanation.options->reference_psi);
  // The group that the others are measured against has its own slowness.
  add(groups.front().group, groups.front().own_log_ratio);
  for (const LeftoverGroup& group : std::span(groups).subspan(1)) add(group.group, group.log_ratio);
  for (const UnnamedDirection& direction : unnamed_directions(linear)) {
    add(direction.name, std::log1p(direction.evidence));
  }
  add(kAboveNoise, std::log(explanation.cost / noise_cost(explanation)));
  return seen;
}

Leftover leftover_of(const LinearisedValve& linear, const ValveDiagnosisOptions& options) {
  Leftover leftover;
  const double output_range = 2 * options.fit.reference_psi;
  const std::vector<LeftoverGroup> groups = leftover_groups(linear, linear.error(), output_range);
  const LeftoverGroup& at_rest = groups.front();
  for (const LeftoverGroup& group : groups) {
    if (group.group.starts_with(kAtRest)) leftover.at_rest = std::max(leftover.at_rest, group.mean_square);
  }
  if (std::isfinite(at_rest.own_log_ratio)) {
    // Slow noise of the stand itself is there in good valves as well.
    const LeftoverOnGoodValves* good = on_good_valves(at_rest.group, options);
    const double usual = good ? good->mean : 0, between = good ? good->sd : 0;
    leftover.at_rest_deviations =
        (at_rest.own_log_ratio - usual) / std::hypot(between, std::sqrt(2.0 / at_rest.blocks));
    leftover.slow_at_rest = (std::exp(at_rest.own_log_ratio) - std::exp(usual)) / static_cast<double>(kGroupBlock);
  }
  Rarest rarest = rarest_group(groups, options);
  leftover.findings = std::move(rarest.findings);
  for (const UnnamedDirection& direction : unnamed_directions(linear)) {
    const std::optional<GoodValves> good = good_valves(direction.name, options);
    if (!good || !std::isfinite(direction.evidence)) continue;
    const double p = direction_p_value(direction.evidence, good->leftover, good->valves);
    rarest.add(p);
    if (p >= kWorthAFinding) continue;
    Finding finding = left_more(direction.name, std::sqrt(direction.evidence), p);
    const std::vector<LeftoverGroup> beside =
        leftover_groups(linear, linear.residual_without(direction.signature), output_range);
    if (rarest_group(beside, options).p_value() > kWorthAFinding) {
      finding.what = direction.finding;
      finding.where = kUnnamedChange;
    }
    leftover.findings.push_back(std::move(finding));
  }
  leftover.p_value = rarest.p_value();
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

std::optional<Finding> far_above_noise(const Explanation& explanation, double samples,
                                       const ValveDiagnosisOptions& options) {
  const double noise = noise_cost(explanation);
  if (!(noise > 0)) return std::nullopt;
  const double above = explanation.cost / noise;
  const std::optional<GoodValves> good = good_valves(kAboveNoise, options);
  if (!good || !(above > 1 + kMostSlowNoise)) return std::nullopt;
  const int blocks = std::max(1, static_cast<int>(samples / static_cast<double>(kGroupBlock)));
  const auto [t, p] = slower_than_good_valves(std::log(above), blocks, good->leftover, good->valves);
  if (!(p < kWorthAFinding)) return std::nullopt;
  Finding finding = left_more(std::string(kUnnamedChange), t, p);
  finding.what = fmt::format("the simulation leaves {:.2g} times the noise in the rms, and of good valves {:.2g} times",
                             std::sqrt(above), std::exp(0.5 * good->leftover.mean));
  return finding;
}

double usual_above_noise(double noise, const ValveDiagnosisOptions& options) {
  const LeftoverOnGoodValves* known = on_good_valves(kAboveNoise, options);
  return known ? std::max(0.0, noise * std::expm1(known->mean)) : 0;
}

}  // namespace valvetriage
