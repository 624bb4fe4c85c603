#include "core/discrepancy/recording_slip.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <set>
#include <string_view>
#include <vector>

#include "core/discrepancy/valve_catalogue.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::VectorXd;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// What a pressure in psi becomes in another unit.
struct Unit {
  const char* name;
  double per_psi;
};
// NIST SP 811 (2008), appendix B: 1 psi = 6.894757 kPa.
constexpr std::array<Unit, 4> kUnits{
    {{"bar", 0.06894757}, {"kPa", 6.894757}, {"MPa", 0.006894757}, {"mbar", 68.94757}}};
// Of the logarithm of a ratio: more than good valves' gains differ by.
constexpr double kSameRatio = 0.08;
// A pressure in another unit still goes the way of good valves'.
constexpr double kSameShape = 0.99;
// A tail beyond this has no number.
constexpr double kMostDeviation = 1400;

/// Numbers against good valves': any = ratio · good + constant, in the weighted mean square.
struct Compared {
  double ratio = kUnknown;
  double correlation = 0;
};
Compared compare(const VectorXd& any, const VectorXd& good, const VectorXd& weights) {
  const double total = weights.sum();
  const Eigen::ArrayXd w = weights.array();
  const Eigen::ArrayXd one = any.array() - (w * any.array()).sum() / total;
  const Eigen::ArrayXd other = good.array() - (w * good.array()).sum() / total;
  const double of_both = (w * one * other).sum();
  const double of_any = (w * one.square()).sum(), of_good = (w * other.square()).sum();
  if (!(of_good > 0) || !(of_any > 0)) return {};
  return {of_both / of_good, of_both / std::sqrt(of_good * of_any)};
}

/// The pressures against those that the mean of good valves has on the same inputs.
Compared compare_pressures(const Explanation& baseline, const ValvePrior& population) {
  const ValveFitProblem& problem = *baseline.problem;
  VectorXd mean = baseline.v;
  mean.head(population.mean.size()) = population.mean;
  std::vector<double> measured, good;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    const std::vector<double> simulated = problem.simulate(mean, r);
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      if (!recording.is_valid(i)) continue;
      measured.push_back(recording.output.values[i]);
      good.push_back(simulated[i]);
    }
  }
  const auto n = static_cast<Eigen::Index>(measured.size());
  return compare(Eigen::Map<const VectorXd>(measured.data(), n), Eigen::Map<const VectorXd>(good.data(), n),
                 VectorXd::Ones(n));
}

/// What it costs to have another map in place of the fitted one, in noise variances.
double cost_of_map(const Explanation& explanation, const VectorXd& map) {
  VectorXd v = explanation.v;
  v.segment(ValveFitProblem::kParameters, map.size()) = map;
  return explanation.problem->cost(v) - explanation.problem->penalty(v) -
         (explanation.cost - explanation.problem->penalty(explanation.v));
}

Finding finding_of(std::string what, double deviation) {
  return {.what = std::move(what),
          .where = std::string(kStaticMap),
          .statistic = deviation,
          .p_value = chi_squared_upper_tail(1, std::clamp(deviation, 0.0, kMostDeviation)),
          .share_of_structured_residual = kUnknown};
}

/// Whether there is a reading, and no recording's differs from its own first, to the last digit.
bool never_moves(const ValveFitProblem& problem) {
  bool is_any = false;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    std::optional<double> first;
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      if (!recording.is_valid(i)) continue;
      if (!first) first = recording.output.values[i];
      if (recording.output.values[i] != *first) return false;
      is_any = true;
    }
  }
  return is_any;
}

}  // namespace

std::optional<Finding> slip_of_gauge_or_unit(const Explanation& baseline) {
  if (!baseline.options->prior) return std::nullopt;
  const ValvePrior& population = *baseline.options->prior;
  const VectorXd good = population.mean.tail(baseline.problem->knots());
  if (never_moves(*baseline.problem)) {
    return finding_of(
        "pressure never moves, to the last digit: gauge or cable is dead, or the valve does not move; check the gauge "
        "before the valve",
        cost_of_map(baseline, good));
  }
  const Compared pressures = compare_pressures(baseline, population);
  if (pressures.correlation < kSameShape) return std::nullopt;
  for (const Unit& unit : kUnits) {
    if (std::abs(std::log(pressures.ratio / unit.per_psi)) > kSameRatio) continue;
    return finding_of(fmt::format("pressure rises {:.3g} times as far as in good valves, as {} called psi would: check "
                                  "the unit of the pressure",
                                  pressures.ratio, unit.name),
                      cost_of_map(baseline, good));
  }
  return std::nullopt;
}

std::optional<Finding> slip_of_sign(const Explanation& explanation) {
  if (!explanation.options->prior) return std::nullopt;
  const ValveFitProblem& problem = *explanation.problem;
  const VectorXd samples = problem.samples_at_knots();
  const VectorXd map = explanation.v.segment(ValveFitProblem::kParameters, problem.knots());
  const VectorXd good = explanation.options->prior->mean.tail(problem.knots());
  if (!(compare(map, good, samples).ratio < 0)) return std::nullopt;
  const double deviation = cost_of_map(explanation, problem.rising_map(explanation.v));
  if (!(deviation > samples.sum())) return std::nullopt;
  return finding_of("pressure falls as current rises, in good valves it rises: check the sign of the pressure",
                    deviation);
}

ValveDiagnosis conclude_slip(const Explanation& baseline, Finding slip) {
  ValveDiagnosis diagnosis;
  diagnosis.extended_model = baseline.model();
  Discrepancy& discrepancy = diagnosis.discrepancy;
  discrepancy.conclusion = Conclusion::kUnexplained;
  discrepancy.gain = {.rmse_baseline = kUnknown,
                      .rmse_extended = kUnknown,
                      .rmse_black_box = kUnknown,
                      .noise_floor = kUnknown,
                      .reduction = kUnknown,
                      .reduction_ci95 = {kUnknown, kUnknown}};
  discrepancy.candidates.push_back(
      {.cause = "none", .rmse_heldout = kUnknown, .reason = "the simulation leaves more than any good valve would"});
  const ValveCatalogue catalogue = valve_catalogue(LinearisedValve(*baseline.problem, baseline.v), *baseline.options);
  std::set<std::string_view> listed;
  for (const LawVariant& variant : catalogue.variants) {
    if (!listed.insert(variant.law.law->cause).second) continue;
    discrepancy.candidates.push_back({.cause = std::string(variant.law.law->cause),
                                      .rmse_heldout = kUnknown,
                                      .reason = "not compared: the recordings contradict any valve"});
  }
  discrepancy.candidates.push_back(
      {.cause = "unknown", .probability = 1, .rmse_heldout = kUnknown, .reason = slip.what});
  for (const Candidate& candidate : catalogue.untestable) discrepancy.candidates.push_back(candidate);
  discrepancy.findings.push_back(std::move(slip));
  return diagnosis;
}

}  // namespace valvetriage
