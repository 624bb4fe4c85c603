#include "core/discrepancy/joint_fits.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <utility>

#include "core/discrepancy/instants.h"
#include "core/discrepancy/slip_search.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr std::size_t kMostStarts = 32;
// The start that simulates best is not always the one whose fit ends best.
constexpr std::size_t kStartsFromPlace = 2;
// Dry friction from half of what a good spool has to half of what holds one over most of a staircase's steps, over the
// range of inputs; the middle of what its search begins with for the rest.
constexpr double kLeastBreakaway = 0.001, kKineticShare = 0.75, kStribeckSpeed = 0.25;
constexpr int kBreakaways = 7;
constexpr double kNarrow = 5;
// A joint fit that lowers the cost by less than this share of the forecast has not found its way.
constexpr double kLeastKept = 0.5;
// What one loop holds another holds about as far.
constexpr std::array kSharesTakenOver{0.75, 1.0, 1.25};
// A law that comes to lead from the leader's valve has found another: once more from there.
constexpr int kRoundsInPlace = 2;

/// A law of memory on a valve at `place`, where it takes over what held the output over `width_a`. About as wide, each
/// time that of its starts which simulates best.
std::vector<JointStart> taking_over(const Tested& tested, const Explanation& beside, const VectorXd& place,
                                    double width_a) {
  ValveFitOptions options = *beside.options;
  options.laws.push_back(tested.fit.law);
  const ValveFitProblem problem(*beside.problem, options);
  std::vector<JointStart> starts;
  for (const double share : kSharesTakenOver) {
    JointStart best{.baseline = place, .parameters = {}, .width = 1};
    double lowest = std::numeric_limits<double>::infinity();
    for (std::vector<double> start : tested.starts) {
      tested.fit.law.law->memory->take_over(share * width_a, start);
      const double cost = problem.cost(problem.clamped(beside.problem->continued_in(problem, place, start)));
      if (!(cost < lowest)) continue;
      lowest = cost;
      best.parameters = std::move(start);
    }
    if (!best.parameters.empty()) starts.push_back(std::move(best));
  }
  return starts;
}

/// The same in the place of the valve's own loops, as far as these are wider than good valves': before a law of memory
/// is there they take up what it does.
std::vector<JointStart> in_place_of_own_loops(const Tested& tested, const Explanation& beside) {
  if (!tested.fit.law.law->memory || !beside.options->prior) return {};
  VectorXd place = beside.v;
  double excess = 0;
  for (const Index loop : {ValveFitProblem::kLoop, ValveFitProblem::kNarrowLoop}) {
    const double usual = beside.options->prior->mean(loop);
    excess += place(loop) - usual;
    place(loop) = usual;
  }
  return excess > 0 ? taking_over(tested, beside, place, excess) : std::vector<JointStart>{};
}

/// Dry friction from what barely holds a spool to what hardly lets it go.
std::vector<std::vector<double>> friction_ladder(double range_a) {
  std::vector<std::vector<double>> ladder;
  double breakaway_a = kLeastBreakaway * range_a;
  for (int force = 0; force < kBreakaways; ++force, breakaway_a *= 2) {
    ladder.push_back({breakaway_a, kKineticShare * breakaway_a, kStribeckSpeed * range_a, 0});
  }
  return ladder;
}

/// Where a law's joint fit may begin beside where its search ended: from each of the given places of the valve, those
/// of the search's starts which simulate best. Searches over many instants or tones need no more starts.
std::vector<JointStart> joint_starts(const Tested& tested, const Explanation& beside,
                                     std::span<const VectorXd> places) {
  std::vector<JointStart> starts;
  if (tested.fit.law.recording) {
    for (const VectorXd& place : places) {
      if (auto start = change_of_gain(beside, tested.fit.law, place)) starts.push_back(std::move(*start));
    }
    return starts;
  }
  if (tested.starts.size() > kMostStarts) return starts;
  ValveFitOptions options = *beside.options;
  options.laws.push_back(tested.fit.law);
  const ValveFitProblem problem(*beside.problem, options);
  // Secants over wide steps lead from a small friction to none and from a large one past its slips.
  const bool sticks = makes_stick(tested.fit.law, beside);
  const std::vector<std::vector<double>> candidates =
      sticks ? friction_ladder(options.knots.back() - options.knots.front()) : tested.starts;
  for (const VectorXd& place : places) {
    std::vector<std::pair<double, const std::vector<double>*>> by_cost;
    for (const std::vector<double>& start : candidates) {
      const double cost = problem.cost(problem.clamped(beside.problem->continued_in(problem, place, start)));
      if (std::isfinite(cost)) by_cost.emplace_back(cost, &start);
    }
    std::sort(by_cost.begin(), by_cost.end());
    if (by_cost.size() > kStartsFromPlace) by_cost.resize(kStartsFromPlace);
    const bool is_fitted = &place == &places.front();
    const double width = !sticks ? 0 : is_fitted ? 1 : kNarrow;
    for (const auto& [cost, start] : by_cost) starts.push_back({place, *start, width});
  }
  return starts;
}

/// A law that acts at one of two places, ahead of the map or behind it, at the one where the survey has not put it.
std::optional<Tested> at_other_place(const Tested& tested) {
  const LawInFit& law = tested.fit.law;
  if (!law.law->is_in_blocks || law.step.back() > 0 || law.own() > 0) return std::nullopt;
  Tested other = tested;
  const double place = 1 - law.lower.back();
  other.fit.law.lower.back() = other.fit.law.upper.back() = place;
  other.fit.law.start.back() = other.fit.parameters.back() = other.fit.shape.back() = place;
  for (std::vector<double>& start : other.starts) start.back() = place;
  return other;
}

/// The valve under an explanation's last law.
VectorXd valve_under(const Explanation& explanation) {
  return without(explanation, explanation.laws.size() - 1, 0).v;
}

/// The cost of a fit that is far from being a rival where another one removes `reduction` of what the valve alone
/// leaves: by the margin twice, for a forecast that is little is off by more than others.
double still_near(const Explanation& beside, double reduction) {
  return beside.cost - kStillNear * kStillNear * std::max(0.0, reduction);
}

/// A law of the race once more, from other starts; the better of its fits stays.
void fit_again(std::size_t i, const Explanation& beside, std::span<const JointStart> starts, JointFits& joint) {
  if (starts.empty()) return;
  Explanation fitted = extend_from(starts, beside, joint.racing[i]->fit, kJointSteps, joint.to_reach(beside));
  joint.compare(fitted);
  if (fitted.cost < joint.fitted[i].cost) joint.fitted[i] = std::move(fitted);
}

/// Friction that is the same at rest and in motion has no slips for a fit to lose its way among. Fitted as that from
/// the given starts it is where the fit of the whole law begins: that ends no worse.
std::vector<JointStart> from_its_smooth_limit(const Tested& tested, const Explanation& beside,
                                              std::span<const JointStart> starts, const JointFits& joint) {
  const auto smooth = tested.fit.law.law->memory->smooth_at_most;
  if (!smooth || starts.empty()) return {};
  LawFit limit = tested.fit;
  limit.law.lower[*smooth] = limit.law.start[*smooth] = limit.law.upper[*smooth];
  limit.law.step[*smooth] = 0;
  std::vector<JointStart> at_limit(starts.begin(), starts.end());
  for (JointStart& start : at_limit) start.parameters[*smooth] = limit.law.upper[*smooth];
  const Explanation fitted = extend_from(at_limit, beside, limit, kJointSteps, joint.to_reach(beside));
  std::vector<double> parameters = fitted.parameters_of_last();
  parameters[*smooth] = parameters[tested.fit.law.law->size_parameter];
  return {{.baseline = valve_under(fitted), .parameters = std::move(parameters), .width = 1}};
}

/// Whether a fit has kept little of what was forecast, and there is another place to begin from: the valve's own
/// parameters have taken up so much of the law that no way leads on from there. One that was given up is nobody's
/// rival.
bool keeps_little(const Tested& tested, const Explanation& beside, const Explanation& fitted) {
  if (!beside.options->prior || fitted.given_up || tested.promise.value <= kLeastEvidence) return false;
  if (!tested.fit.law.recording && tested.starts.size() > kMostStarts) return false;
  return beside.cost - fitted.cost < kLeastKept * tested.fit.reduction;
}

}  // namespace

bool JointFits::has(std::string_view cause) const {
  return std::any_of(racing.begin(), racing.end(), [&](const Tested* tested) { return tested->cause() == cause; });
}

void JointFits::compare(const Explanation& with) {
  if (with.cost >= lowest) return;
  lowest = with.cost;
  inflation = noise_inflation(whitened_residual(with));
}

ToReach JointFits::to_reach(const Explanation& beside) const {
  return {.lead = lowest - kInTheRace * inflation, .matters = still_near(beside, beside.cost - lowest)};
}

VectorXd at_population_mean(const Explanation& explanation) {
  VectorXd v = explanation.v;
  if (explanation.options->prior) v.head(explanation.problem->baseline_size()) = explanation.options->prior->mean;
  return explanation.problem->clamped(v);
}

void fit_jointly(const std::vector<const Tested*>& entering, const Explanation& beside, bool bent, JointFits& joint) {
  const std::vector<VectorXd> both_places{beside.v, at_population_mean(beside)};
  const auto fit = [&](const Tested& tested, bool from_both) {
    std::vector<JointStart> starts = from_both ? joint_starts(tested, beside, both_places) : std::vector<JointStart>{};
    for (JointStart& start : in_place_of_own_loops(tested, beside)) starts.push_back(std::move(start));
    Explanation fitted = extend(beside, tested.fit, kJointSteps, joint.to_reach(beside), starts);
    if (tested.fit.law.recording) fitted = at_its_instant(std::move(fitted), beside, tested.fit, kJointSteps);
    joint.compare(fitted);
    return fitted;
  };
  for (const Tested* tested : entering) {
    joint.racing.push_back(tested);
    joint.fitted.push_back(fit(*tested, bent));
    const bool is_lost = !bent && keeps_little(*tested, beside, joint.fitted.back());
    if (is_lost) {
      Explanation fitted = fit(*tested, true);
      if (fitted.cost < joint.fitted.back().cost) joint.fitted.back() = std::move(fitted);
    }
    // The survey has chosen the place by a forecast, and from a bent fit that says little: it stands where the other
    // place is not surely better.
    std::optional<Tested> moved = bent || is_lost ? at_other_place(*tested) : std::nullopt;
    if (!moved) continue;
    Explanation fitted = fit(*moved, true);
    if (!(fitted.cost < joint.fitted.back().cost - kLeastEvidence)) continue;
    joint.moved.push_back(std::move(*moved));
    joint.racing.back() = &joint.moved.back();
    joint.fitted.back() = std::move(fitted);
  }
}

void fit_in_place_of_kin(const Explanation& beside, JointFits& joint) {
  std::optional<std::size_t> best;
  for (std::size_t i = 0; i < joint.fitted.size(); ++i) {
    if (joint.racing[i]->is_of_memory() && (!best || joint.fitted[i].cost < joint.fitted[*best].cost)) best = i;
  }
  if (!best || joint.fitted[*best].cost >= beside.cost) return;
  const Explanation& leading = joint.fitted[*best];
  const VectorXd place = valve_under(leading);
  const double width_a = leading.laws.back().law.law->memory->width_a(leading.parameters_of_last());
  const double cost = leading.cost;
  joint.in_place_of.resize(joint.fitted.size(), std::numeric_limits<double>::infinity());
  for (std::size_t i = 0; i < joint.fitted.size(); ++i) {
    if (i == *best || !joint.racing[i]->is_of_memory() || joint.in_place_of[i] == cost) continue;
    joint.in_place_of[i] = cost;
    const Tested& tested = *joint.racing[i];
    const std::vector<JointStart> starts = taking_over(tested, beside, place, width_a);
    fit_again(i, beside, starts, joint);
    fit_again(i, beside, from_its_smooth_limit(tested, beside, starts, joint), joint);
  }
}

void fit_in_place_of_leader(const Explanation& beside, JointFits& joint) {
  for (int round = 0; round < kRoundsInPlace; ++round) {
    const Explanation& leading = closest_of(joint, beside);
    if (&leading == &beside) return;
    const auto leader = static_cast<std::size_t>(&leading - joint.fitted.data());
    const double lowest = leading.cost;
    const VectorXd place = valve_under(leading);
    for (std::size_t i = 0; i < joint.fitted.size(); ++i) {
      const Tested& tested = *joint.racing[i];
      if (i == leader || tested.fit.law.recording) continue;
      fit_again(i, beside, joint_starts(tested, beside, {&place, 1}), joint);
    }
    if (!(joint.lowest < lowest)) return;
  }
}

bool lead_on(const Explanation& beside, double reduction, JointFits& joint) {
  const double near = still_near(beside, reduction);
  bool any = false;
  for (Explanation& fit : joint.fitted) {
    if (!fit.given_up || !(*fit.given_up < near)) continue;
    fit = led_on(std::move(fit), kJointSteps, {.lead = near, .matters = near});
    joint.compare(fit);
    any = true;
  }
  return any;
}

const Explanation& closest_of(const JointFits& joint, const Explanation& beside) {
  const auto lowest = std::min_element(joint.fitted.begin(), joint.fitted.end(),
                                       [](const Explanation& a, const Explanation& b) { return a.cost < b.cost; });
  return lowest == joint.fitted.end() || lowest->cost >= beside.cost ? beside : *lowest;
}

void fit_what_sticks(const Survey& survey, const Explanation& beside, JointFits& joint) {
  for (const Tested& tested : survey.tested) {
    if (makes_stick(tested.fit.law, beside) && !joint.has(tested.cause())) fit_jointly({&tested}, beside, true, joint);
  }
}

void fit_from_slips(const Explanation& beside, JointFits& joint) {
  const VectorXd place = at_population_mean(beside);
  for (std::size_t i = 0; i < joint.racing.size(); ++i) {
    const LawInFit& law = joint.racing[i]->fit.law;
    if (makes_stick(law, beside))
      fit_again(i, beside, slip_starts(beside, law, place, closest_of(joint, beside)), joint);
  }
}

}  // namespace valvetriage
