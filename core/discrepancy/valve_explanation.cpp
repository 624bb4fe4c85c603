#include "core/discrepancy/valve_explanation.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kIterationsAtATime = 4;
// Where several starts compete; the others end up at the same place or far from it.
constexpr int kScoutIterations = 3;
// Of the differences, where a rough cost is searched once more.
constexpr double kWideAgain = ValveFitProblem::kWide / 4;
// A descent gains less and less: no more than this many times what it gained last.
constexpr double kMoreToGain = 3;
// A quarter of a noise variance in 24,000 samples: far below what any decision turns on.
constexpr double kSmallestGain = 1e-5;
// Parts of a recording that a law's error may differ between.
constexpr Index kScoreBlocks = 4;

std::unique_ptr<ValveFitProblem> problem_of(std::span<const Recording> recordings, const ValveFitOptions& options) {
  return std::make_unique<ValveFitProblem>(recordings, options);
}

/// Whether the law that came last does anything with these parameters; one that is on or off does.
bool law_acts(const ValveFitProblem& problem, const LawInFit& law, std::size_t at, const VectorXd& v) {
  if (law.law->size_parameter >= law.law->parameters.size()) return true;
  const std::size_t recording = law.recording.value_or(0);
  return problem.law_parameters(v, at, recording)[law.law->size_parameter] != law.law->neutral;
}

}  // namespace

Explanation Explanation::copy() const {
  Explanation copy;
  copy.options = std::make_unique<ValveFitOptions>(*options);
  copy.problem = std::make_unique<ValveFitProblem>(*problem, *copy.options);
  copy.v = v;
  copy.cost = cost;
  copy.laws = laws;
  copy.given_up = given_up;
  return copy;
}

Model Explanation::model() const {
  const VectorXd map = problem->rising_map(v);
  const std::vector<double> outputs(map.data(), map.data() + map.size());
  Model model = to_model(to_parameters(v.head(ValveFitProblem::kParameters), options->reference_psi, options->usual),
                         KnotCurve(options->knots).rising_through(outputs), options->usual);
  for (std::size_t l = 0; l < options->laws.size(); ++l) {
    const LawInFit& law = options->laws[l];
    const std::vector<double> parameters = problem->law_parameters(v, l, law.recording.value_or(0));
    MechanismUse use{.cause = std::string(law.law->cause), .parameters = law.law->as_written(parameters, model.volume)};
    if (law.channel) use.channel = problem->recording(0).side[*law.channel].name;
    if (law.recording) use.channel = problem->recording(*law.recording).name;
    model.mechanisms.push_back(std::move(use));
  }
  return model;
}

namespace {

/// Where the vector has every parameter of every law, in order (own ones: the first recording's).
std::vector<Index> law_entries(const Explanation& explanation) {
  std::vector<Index> entries;
  for (std::size_t l = 0; l < explanation.options->laws.size(); ++l) {
    for (std::size_t j = 0; j < explanation.options->laws[l].law->parameters.size(); ++j)
      entries.push_back(explanation.problem->law_entry(l, j, 0));
  }
  return entries;
}

/// Of everything fitted together, and how far the scores of parts of the recordings pull every entry.
struct Uncertainty {
  MatrixXd covariance;       ///< in noise of unit variance
  std::vector<double> pull;  ///< variance of the sandwich, by entry

  /// Of an entry of a law. Of noise that many times louder, or of the sandwich, whichever is more.
  double of_law(Index entry, double inflation) const {
    return std::max(covariance(entry, entry) * inflation, pull[static_cast<std::size_t>(entry)]);
  }
};

Uncertainty uncertainty_of(const Explanation& explanation) {
  const ValveFitProblem& problem = *explanation.problem;
  ValveFitProblem::Normal normal{MatrixXd::Zero(problem.size(), problem.size()), VectorXd::Zero(problem.size())};
  std::vector<VectorXd> scores;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const ValveFitProblem::Rows rows = problem.rows(explanation.v, r);
    const Index own = problem.own_at(r), shared = problem.shared();
    const Index count = rows.error.size();
    for (Index block = 0; block < kScoreBlocks; ++block) {
      const Index first = block * count / kScoreBlocks, last = (block + 1) * count / kScoreBlocks;
      problem.accumulate(rows, first, last - first, r, normal);
      const VectorXd score = rows.jacobian.transposed_times(first, rows.error.segment(first, last - first));
      scores.push_back(VectorXd::Zero(problem.size()));
      scores.back().head(shared) = score.head(shared);
      scores.back().segment(own, problem.own()) = score.tail(problem.own());
    }
  }
  problem.add_penalty(explanation.v, normal);
  Uncertainty of{inverse_of_symmetric(normal.a), {}};
  of.pull.assign(static_cast<std::size_t>(problem.size()), 0);
  for (const VectorXd& score : scores) {
    const VectorXd moved = of.covariance * score;
    for (Index j = 0; j < moved.size(); ++j) of.pull[static_cast<std::size_t>(j)] += moved(j) * moved(j);
  }
  return of;
}

/// One more law, nothing fitted yet.
Explanation with_law(const Explanation& explanation, const LawFit& law) {
  Explanation extended;
  extended.options = std::make_unique<ValveFitOptions>(*explanation.options);
  extended.options->laws.push_back(law.law);
  extended.problem = std::make_unique<ValveFitProblem>(*explanation.problem, *extended.options);
  extended.laws = explanation.laws;
  extended.laws.push_back(law);
  return extended;
}

/// Where the search of an explanation's last law ended. Its linear forecast of where the valve moves may overshoot; the
/// valve where it stood, if that is better.
Descent from_search(const Explanation& extended, const Explanation& explanation) {
  const ValveFitProblem& problem = *extended.problem;
  const LawFit& law = extended.laws.back();
  const VectorXd moved = explanation.problem->continued_in(problem, law.baseline, law.parameters);
  const VectorXd stayed = explanation.problem->continued_in(problem, explanation.v, law.parameters);
  return descent_from(problem, problem.cost(moved) < problem.cost(stayed) ? moved : stayed);
}

void add_starts(std::span<const JointStart> starts, const Explanation& extended, const Explanation& explanation,
                std::vector<Descent>& scouts) {
  const ValveFitProblem& problem = *extended.problem;
  for (const JointStart& start : starts) {
    scouts.push_back(
        descent_from(problem, explanation.problem->continued_in(problem, start.baseline, start.parameters)));
    if (start.width > 0) scouts.back().width = std::min(scouts.back().width, start.width);
  }
}

/// On from where a descent stands, as far as it still matters; `before` is its cost some iterations ago.
Descent led_down(const ValveFitProblem& problem, Descent descent, double before, int most_iterations,
                 const ToReach& to_reach) {
  for (int steps = 0; steps < most_iterations; steps += kIterationsAtATime) {
    descent = descend_on(problem, std::move(descent), kIterationsAtATime, kSmallestGain, to_reach.matters);
    const double gained = before - descent.cost;
    before = descent.cost;
    if (descent.termination != FitTermination::kIterationLimit) break;
    if (std::isfinite(gained) && descent.cost - kMoreToGain * gained > to_reach.lead) break;
  }
  return descent;
}

/// Fitted from whichever of its scouts is better after a few iterations.
Explanation fitted_from(std::vector<Descent> scouts, Explanation extended, int most_iterations,
                        const ToReach& to_reach) {
  const ValveFitProblem& problem = *extended.problem;
  const bool compete = scouts.size() > 1;
  int left = most_iterations;
  if (compete) {
    for (Descent& scout : scouts)
      scout = descend_on(problem, std::move(scout), kScoutIterations, kSmallestGain, to_reach.matters);
    left -= kScoutIterations;
  }
  // A scout that has given the law up is no better than without it, and at its end: another may still come below.
  const auto acts = [&](const Descent& d) {
    return law_acts(problem, extended.laws.back().law, extended.laws.size() - 1, d.v);
  };
  const auto by_cost = [&](const Descent& a, const Descent& b) {
    const bool a_acts = acts(a), b_acts = acts(b);
    return a_acts != b_acts ? a_acts : a.cost < b.cost;
  };
  std::stable_sort(scouts.begin(), scouts.end(), by_cost);
  const Descent lowest = *std::min_element(scouts.begin(), scouts.end(),
                                           [](const Descent& a, const Descent& b) { return a.cost < b.cost; });
  const double before = compete ? scouts.front().cost : std::numeric_limits<double>::infinity();
  Descent best = led_down(problem, scouts.front(), before, left, to_reach);
  if (compete && problem.sticks(best.v)) {
    // A rough cost has many valleys: from wider secants there may be a lower one beside this.
    Descent again = descent_from(problem, best.v);
    again.width = kWideAgain;
    again = led_down(problem, std::move(again), best.cost, left, to_reach);
    if (again.cost < best.cost) best = std::move(again);
  }
  if (lowest.cost < best.cost) best = lowest;
  extended.v = std::move(best.v);
  extended.cost = best.cost;
  if (best.termination == FitTermination::kGivenUp) extended.given_up = to_reach.matters;
  return extended;
}

}  // namespace

std::vector<double> Explanation::standard_errors(double inflation) const {
  const Uncertainty of = uncertainty_of(*this);
  std::vector<double> errors;
  for (const Index entry : law_entries(*this)) {
    const double variance = of.of_law(entry, inflation);
    errors.push_back(variance > 0 ? std::sqrt(variance) : std::numeric_limits<double>::quiet_NaN());
  }
  return errors;
}

std::vector<Model> Explanation::moved_models(double inflation) const {
  constexpr double kNegligible = 1e-3;
  const Uncertainty of = uncertainty_of(*this);
  std::vector<Index> entries;
  std::vector<double> deviations;
  const auto add = [&](Index entry, double variance) {
    if (!std::isfinite(variance) || !(variance > 0)) return;
    entries.push_back(entry);
    deviations.push_back(std::sqrt(variance));
  };
  for (Index j = 0; j < problem->baseline_size(); ++j) add(j, of.covariance(j, j) * inflation);
  for (std::size_t l = 0; l < options->laws.size(); ++l) {
    for (std::size_t j = 0; j < options->laws[l].shared(); ++j) {
      const Index entry = problem->law_entry(l, j, 0);
      add(entry, of.of_law(entry, inflation));
    }
  }
  const auto n = static_cast<Index>(entries.size());
  MatrixXd correlation(n, n);
  for (Index i = 0; i < n; ++i) {
    for (Index j = 0; j < n; ++j) {
      const Index a = entries[static_cast<std::size_t>(i)], b = entries[static_cast<std::size_t>(j)];
      correlation(i, j) = of.covariance(a, b) / std::sqrt(of.covariance(a, a) * of.covariance(b, b));
    }
  }
  const SymmetricEigen axes = symmetric_eigen(correlation);
  Explanation moved = copy();
  std::vector<Model> models;
  for (Index k = 0; k < n; ++k) {
    if (axes.values(k) < kNegligible) continue;
    moved.v = v;
    for (Index i = 0; i < n; ++i) {
      const auto at = static_cast<std::size_t>(i);
      moved.v(entries[at]) += deviations[at] * std::sqrt(axes.values(k)) * axes.vectors(i, k);
    }
    moved.v = problem->clamped(std::move(moved.v));
    models.push_back(moved.model());
  }
  // What a recording has of its own, a phase or the state it begins in, may be anything in another one: two more of a
  // phase span both quadratures.
  for (std::size_t l = 0; l < options->laws.size(); ++l) {
    const LawInFit& law = options->laws[l];
    for (std::size_t j = law.shared(); j < law.shared() + law.own(); ++j) {
      const Index entry = problem->law_entry(l, j, 0);
      const double lower = law.lower[j], range = law.upper[j] - lower;
      for (const double part : {1.0 / 3, 2.0 / 3}) {
        moved.v = v;
        moved.v(entry) = lower + std::fmod(v(entry) - lower + part * range, range);
        models.push_back(moved.model());
      }
    }
  }
  return models;
}

Explanation explain_nothing(std::span<const Recording> recordings, const ValveFitOptions& options,
                            const ValveFit& fit) {
  Explanation nothing;
  nothing.options = std::make_unique<ValveFitOptions>(options);
  nothing.problem = problem_of(recordings, *nothing.options);
  nothing.v = fit.vector;
  nothing.cost = nothing.problem->cost(nothing.v);
  return nothing;
}

Explanation extend(const Explanation& explanation, const LawFit& law, int most_iterations, const ToReach& to_reach,
                   std::span<const JointStart> others) {
  Explanation extended = with_law(explanation, law);
  std::vector<Descent> scouts{from_search(extended, explanation)};
  add_starts(others, extended, explanation, scouts);
  return fitted_from(std::move(scouts), std::move(extended), most_iterations, to_reach);
}

Explanation extend_from(std::span<const JointStart> starts, const Explanation& explanation, const LawFit& law,
                        int most_iterations, const ToReach& to_reach) {
  Explanation extended = with_law(explanation, law);
  std::vector<Descent> scouts;
  add_starts(starts, extended, explanation, scouts);
  return fitted_from(std::move(scouts), std::move(extended), most_iterations, to_reach);
}

Explanation led_on(Explanation given_up, int most_iterations, const ToReach& to_reach) {
  std::vector<Descent> start{descent_from(*given_up.problem, given_up.v)};
  given_up.given_up.reset();
  return fitted_from(std::move(start), std::move(given_up), most_iterations, to_reach);
}

Explanation without(const Explanation& explanation, std::size_t law, int most_iterations) {
  Explanation less;
  less.options = std::make_unique<ValveFitOptions>(*explanation.options);
  less.options->laws.erase(less.options->laws.begin() + static_cast<std::ptrdiff_t>(law));
  less.problem = std::make_unique<ValveFitProblem>(*explanation.problem, *less.options);
  less.laws = explanation.laws;
  less.laws.erase(less.laws.begin() + static_cast<std::ptrdiff_t>(law));
  VectorXd v = VectorXd::Zero(less.problem->size());
  const Index baseline = explanation.problem->baseline_size();
  v.head(baseline) = explanation.v.head(baseline);
  Index to = baseline, from = baseline;
  for (std::size_t l = 0; l < explanation.laws.size(); ++l) {
    const auto shared = static_cast<Index>(explanation.laws[l].law.shared());
    if (l != law) {
      v.segment(to, shared) = explanation.v.segment(from, shared);
      to += shared;
    }
    from += shared;
  }
  for (std::size_t r = 0; r < less.problem->recordings(); ++r) {
    Index own_to = ValveFitProblem::kStarts, own_from = ValveFitProblem::kStarts;
    v.segment(less.problem->own_at(r), own_to) = explanation.v.segment(explanation.problem->own_at(r), own_to);
    for (std::size_t l = 0; l < explanation.laws.size(); ++l) {
      const auto own = static_cast<Index>(explanation.laws[l].law.own());
      if (l != law) {
        v.segment(less.problem->own_at(r) + own_to, own) =
            explanation.v.segment(explanation.problem->own_at(r) + own_from, own);
        own_to += own;
      }
      own_from += own;
    }
  }
  Descent descent = descend(*less.problem, less.problem->clamped(v), most_iterations, kSmallestGain);
  less.v = std::move(descent.v);
  less.cost = descent.cost;
  return less;
}

Stack whitened_residual(const Explanation& explanation) {
  Stack residual;
  const ValveFitProblem& problem = *explanation.problem;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    const std::vector<double> simulated = problem.simulate(explanation.v, r);
    std::vector<double> kept;
    std::vector<std::size_t> samples;
    for (std::size_t i = 0; i < simulated.size(); ++i) {
      if (!recording.is_valid(i)) continue;
      kept.push_back(recording.output.values[i] - simulated[i]);
      samples.push_back(i);
    }
    residual.push_back(Eigen::Map<const VectorXd>(kept.data(), static_cast<Index>(kept.size())));
    problem.whiten(r, samples, residual.back());
  }
  return residual;
}

}  // namespace valvetriage
