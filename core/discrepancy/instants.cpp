#include "core/discrepancy/instants.h"

#include <algorithm>
#include <cmath>

#include "core/discrepancy/gain_split.h"
#include "core/discrepancy/valve_catalogue.h"

namespace valvetriage {
namespace {

constexpr int kMostRepeats = 4;
// Of the input's range: what moves less is a hold.
constexpr double kHold = 0.02;
// Of the samples: where more of them follow a move of the input, one more that does says little.
constexpr double kFewMoves = 0.2;

/// Time by which a valve has given most of its answer to a step [s].
double answer_s(const Explanation& explanation) {
  const ValveFitOptions& options = *explanation.options;
  const ValveParameters valve = to_parameters(explanation.v, options.reference_psi, options.usual);
  return valve.spool.delay_s + 1 / valve.spool.natural_frequency_rad_s + valve.lag_behind_map_s();
}

}  // namespace

std::optional<JointStart> change_of_gain(const Explanation& beside, const LawInFit& law, const Eigen::VectorXd& place) {
  const std::size_t r = *law.recording;
  const Recording& recording = beside.problem->recording(r);
  const std::vector<GainSplit> splits = split_gains(beside.problem->simulate(place, r), recording.output.values,
                                                    [&](std::size_t i) { return recording.is_valid(i); });
  std::optional<GainSplit> best;
  for (const GainSplit& split : splits) {
    const double time_s = static_cast<double>(split.sample) * recording.sample_period_s;
    const bool is_within = time_s > law.lower[kInstantOf] && time_s < law.upper[kInstantOf];
    if (is_within && (!best || split.taken > best->taken)) best = split;
  }
  if (!best) return std::nullopt;
  JointStart start{.baseline = place, .parameters = law.lower};
  start.parameters[kInstantOf] = (static_cast<double>(best->sample) - 0.5) * recording.sample_period_s;
  start.parameters[law.law->size_parameter] = best->change;
  return start;
}

Explanation at_its_instant(Explanation fitted, const Explanation& beside, const LawFit& law, int most_iterations) {
  for (int repeat = 0; repeat < kMostRepeats; ++repeat) {
    const std::size_t last = fitted.laws.size() - 1;
    const auto start = change_of_gain(beside, law.law, without(fitted, last, 0).v);
    if (!start) break;
    const double moved_s = start->parameters[kInstantOf] - fitted.parameters_of_last()[kInstantOf];
    if (std::abs(moved_s) < beside.problem->recording(*law.law.recording).sample_period_s) break;
    Explanation again = extend_from({&*start, 1}, beside, law, most_iterations, {.lead = fitted.cost});
    if (again.cost >= fitted.cost) break;
    fitted = std::move(again);
  }
  return fitted;
}

bool may_begin_with_input(const Explanation& explanation, std::size_t law, double inflation) {
  const LawFit& fit = explanation.laws[law];
  const ValveFitProblem& problem = *explanation.problem;
  const Recording& recording = problem.recording(*fit.law.recording);
  const std::vector<double>& input = recording.input.values;
  const auto [lowest, highest] = std::minmax_element(input.begin(), input.end());
  const double hold = kHold * (*highest - *lowest);
  const auto answer = static_cast<std::ptrdiff_t>(std::ceil(answer_s(explanation) / recording.sample_period_s));
  const auto follows_move = [&](std::ptrdiff_t i) {
    const auto [low, high] =
        std::minmax_element(input.begin() + std::max<std::ptrdiff_t>(0, i - answer), input.begin() + i + 1);
    return *high - *low > hold;
  };
  const auto samples = static_cast<std::ptrdiff_t>(input.size());
  std::vector<double> begins_s;
  std::ptrdiff_t moved = 0;
  for (std::ptrdiff_t i = 1; i < samples; ++i) {
    if (!follows_move(i)) continue;
    ++moved;
    if (!follows_move(i - 1)) begins_s.push_back(static_cast<double>(i) * recording.sample_period_s);
  }
  if (static_cast<double>(moved) > kFewMoves * static_cast<double>(samples)) return false;
  const Eigen::Index entry = problem.law_entry(law, kInstantOf, *fit.law.recording);
  const auto instant = static_cast<std::ptrdiff_t>(std::ceil(explanation.v(entry) / recording.sample_period_s));
  if (follows_move(std::clamp<std::ptrdiff_t>(instant, 1, samples - 1))) return true;
  const double most = explanation.cost + kTwoSided95 * kTwoSided95 * inflation;
  return std::any_of(begins_s.begin(), begins_s.end(), [&](double begin_s) {
    Eigen::VectorXd v = explanation.v;
    v(entry) = begin_s;
    return problem.cost(v) < most;
  });
}

}  // namespace valvetriage
