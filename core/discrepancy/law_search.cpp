#include "core/discrepancy/law_search.h"

#include <algorithm>
#include <cmath>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// A signature below this is no effect that the recordings could show: a hundredth of one sample's noise.
constexpr double kLeastEffect = 1e-4;
constexpr std::size_t kManyParameters = 6, kFinalists = 6;
// Starts whose effects are projected together.
constexpr std::size_t kStartsAtOnce = 8;
/// A valve this far from good ones, in noise variances, is worth a law in the place of its own parameters.
constexpr double kLeastInPlace = 8;

/// One law around a linearised valve: simulated for any parameters, compared in the projected metric.
class Search {
 public:
  Search(const LinearisedValve& fit, const ValveFitOptions& options, const LawInFit& law)
      : fit_(fit), options_(with(options, law)), problem_(fit.problem(), options_), law_(options_.laws.back()) {}

  int simulations() const { return simulations_; }

  LinearisedValve::Signature effect(const std::vector<double>& parameters) {
    return fit_.signature(column(parameters));
  }
  std::vector<LinearisedValve::Signature> effects(std::span<const std::vector<double>> each) {
    std::vector<Stack> columns;
    for (const std::vector<double>& parameters : each) columns.push_back(column(parameters));
    return fit_.signatures(std::move(columns));
  }

  /// Of the whole vector, everything simulated.
  double cost(const VectorXd& baseline, const std::vector<double>& parameters) {
    simulations_ += static_cast<int>(problem_.recordings());
    return problem_.cost(fit_.problem().continued_in(problem_, baseline, parameters));
  }

  /// Of the whole vector at the rows, everything simulated.
  Stack residual(const VectorXd& baseline, const std::vector<double>& parameters) {
    simulations_ += static_cast<int>(problem_.recordings());
    const VectorXd v = fit_.problem().continued_in(problem_, baseline, parameters);
    const std::vector<ValveFitProblem::Run> at_v = problem_.all_runs(v);
    Stack residual;
    for (std::size_t r = 0; r < problem_.recordings(); ++r) {
      residual.push_back(fit_.error()[r] - fit_.whitened(r, at_v[r].output));
    }
    return residual;
  }

  /// How the law changes the reading, whitened.
  Stack column(const std::vector<double>& parameters) {
    std::vector<std::size_t> acted_on;
    Stack column;
    for (std::size_t r = 0; r < problem_.recordings(); ++r) {
      column.push_back(VectorXd::Zero(fit_.error()[r].size()));
      if (problem_.acts(law_, r)) acted_on.push_back(r);
    }
    put_in(parameters, acted_on, column);
    return column;
  }
  /// The same of parameters that differ from those of `at` in one recording's own entry only.
  Stack column_of_own(const std::vector<double>& parameters, std::size_t recording, const Stack& at) {
    Stack column = at;
    put_in(parameters, {&recording, 1}, column);
    return column;
  }
  /// The recording whose own entry j is; empty for a shared one.
  std::optional<std::size_t> owner(std::size_t j) const {
    if (j < law_.shared()) return std::nullopt;
    return (j - law_.shared()) / law_.own();
  }

  std::vector<double> clamped(std::vector<double> parameters) const {
    for (std::size_t j = 0; j < parameters.size(); ++j) {
      const std::size_t k = index_of_law(j);
      parameters[j] = std::clamp(parameters[j], law_.lower[k], law_.upper[k]);
    }
    return parameters;
  }
  /// The entry of the law's own table behind entry j of a search's vector.
  std::size_t index_of_law(std::size_t j) const {
    return j < law_.shared() ? j : law_.shared() + (j - law_.shared()) % std::max<std::size_t>(law_.own(), 1);
  }
  double step(std::size_t j) const { return law_.step[index_of_law(j)]; }
  double upper(std::size_t j) const { return law_.upper[index_of_law(j)]; }
  Index freedoms() const {
    Index varied = 0;
    for (std::size_t j = 0; j < law_.law->parameters.size(); ++j) {
      if (law_.step[j] > 0) varied += j < law_.shared() ? 1 : static_cast<Index>(problem_.recordings());
    }
    return varied;
  }

 private:
  static ValveFitOptions with(ValveFitOptions options, const LawInFit& law) {
    options.laws.push_back(law);
    return options;
  }

  void put_in(const std::vector<double>& parameters, std::span<const std::size_t> recordings, Stack& column) {
    const VectorXd v = fit_.problem().continued_in(problem_, fit_.at(), parameters);
    const auto outputs = problem_.simulate_behind_last(v, recordings, fit_.runs());
    for (std::size_t k = 0; k < recordings.size(); ++k) {
      column[recordings[k]] = fit_.whitened(recordings[k], outputs[k]);
    }
    simulations_ += static_cast<int>(recordings.size());
  }

  const LinearisedValve& fit_;
  ValveFitOptions options_;
  ValveFitProblem problem_;
  const LawInFit& law_;
  int simulations_ = 0;
};

struct Point {
  double promise = 0;  ///< gain at the best size in proportion
  std::vector<double> parameters;
  LinearisedValve::Signature effect;
  double cost = 0;  ///< relative to no law
};

/// The size that explains most, where the effect grows in proportion to it.
std::vector<double> scaled(const Point& point, const LinearisedValve& fit, const Mechanism& law) {
  if (!std::isfinite(law.neutral)) return point.parameters;
  const double share = fit.against_error(point.effect) / fit.product(point.effect, point.effect);
  if (!(share > 0.01)) return point.parameters;
  std::vector<double> parameters = point.parameters;
  if (law.size_parameter >= parameters.size()) return parameters;
  double& size = parameters[law.size_parameter];
  size = law.neutral + share * (size - law.neutral);
  return parameters;
}

/// The same size on the other side of no effect; nothing where the law has none there.
std::optional<std::vector<double>> mirrored(const Search& search, const LawInFit& law, std::vector<double> parameters) {
  const std::size_t at = law.law->size_parameter;
  const double neutral = law.law->neutral;
  if (at >= parameters.size() || !std::isfinite(neutral) || !(law.lower[at] < neutral)) return std::nullopt;
  parameters[at] = 2 * neutral - parameters[at];
  parameters = search.clamped(std::move(parameters));
  if (parameters[at] == neutral) return std::nullopt;
  return parameters;
}

Point point_with(const LinearisedValve& fit, std::vector<double> parameters, LinearisedValve::Signature effect) {
  Point point{.parameters = std::move(parameters), .effect = std::move(effect)};
  const double size = fit.product(point.effect, point.effect);
  if (!(size > kLeastEffect)) return point;
  const double against = fit.against_error(point.effect);
  point.promise = against > 0 ? against * against / size : 0;
  point.cost = fit.cost_without(point.effect);
  return point;
}

Point point_at(Search& search, const LinearisedValve& fit, std::vector<double> parameters) {
  LinearisedValve::Signature effect = search.effect(parameters);
  return point_with(fit, std::move(parameters), std::move(effect));
}

/// The starts that promise most, best first. Whichever sign a start has, the recordings tell the effect's.
std::vector<Point> best_starts(Search& search, const LinearisedValve& fit, const LawInFit& law,
                               const std::vector<std::vector<double>>& starts, std::size_t most) {
  std::vector<Point> best;
  const auto enter = [&](Point point) {
    if (!(fit.product(point.effect, point.effect) > kLeastEffect)) return;
    if (point.promise == 0) {
      if (auto other = mirrored(search, law, point.parameters)) {
        if (Point there = point_at(search, fit, std::move(*other)); there.promise > 0) point = std::move(there);
      }
    }
    const auto behind =
        std::find_if(best.begin(), best.end(), [&](const Point& p) { return p.promise < point.promise; });
    best.insert(behind, std::move(point));
    if (best.size() > most) best.pop_back();
  };
  for (std::size_t first = 0; first < starts.size(); first += kStartsAtOnce) {
    std::vector<std::vector<double>> some;
    for (std::size_t i = first; i < std::min(first + kStartsAtOnce, starts.size()); ++i) {
      some.push_back(search.clamped(starts[i]));
    }
    std::vector<LinearisedValve::Signature> effects = search.effects(some);
    for (std::size_t i = 0; i < some.size(); ++i) enter(point_with(fit, std::move(some[i]), std::move(effects[i])));
  }
  return best;
}

/// One damped Gauss-Newton step; false where none lowers the cost.
bool descend(Search& search, const LinearisedValve& fit, Point& point, double& damping) {
  std::vector<std::size_t> varied;
  for (std::size_t j = 0; j < point.parameters.size(); ++j) {
    if (search.step(j) > 0) varied.push_back(j);
  }
  const std::size_t k = varied.size();
  if (k == 0) return false;
  std::vector<Stack> columns;
  for (const std::size_t j : varied) {
    std::vector<double> moved = point.parameters;
    const double step = moved[j] + search.step(j) > search.upper(j) ? -search.step(j) : search.step(j);
    moved[j] += step;
    const auto owner = search.owner(j);
    columns.push_back(owner ? search.column_of_own(moved, *owner, point.effect.column) : search.column(moved));
    for (std::size_t r = 0; r < columns.back().size(); ++r) {
      columns.back()[r] = (columns.back()[r] - point.effect.column[r]) / step;
    }
  }
  const std::vector<LinearisedValve::Signature> slope = fit.signatures(std::move(columns));
  MatrixXd a(k, k);
  VectorXd b(k);
  for (std::size_t i = 0; i < k; ++i) {
    const auto row = static_cast<Index>(i);
    b(row) = fit.against_error(slope[i]) - fit.product(slope[i], point.effect);
    for (std::size_t j = 0; j < k; ++j) a(row, static_cast<Index>(j)) = fit.product(slope[i], slope[j]);
  }
  for (int attempt = 0; attempt < 4; ++attempt) {
    MatrixXd damped = a;
    damped.diagonal() *= 1 + damping;
    damped.diagonal().array() += 1e-12 * std::max(a.diagonal().maxCoeff(), 1e-12);
    const VectorXd move = solve_symmetric(damped, b);
    Point tried;
    tried.parameters = point.parameters;
    for (std::size_t j = 0; j < k; ++j) tried.parameters[varied[j]] += move(static_cast<Index>(j));
    tried.parameters = search.clamped(tried.parameters);
    tried.effect = search.effect(tried.parameters);
    tried.cost = fit.cost_without(tried.effect);
    if (std::isfinite(tried.cost) && tried.cost < point.cost) {
      point = std::move(tried);
      damping = std::max(damping / 10, 1e-6);
      return true;
    }
    damping *= 10;
  }
  return false;
}

LinearisedValve::Signature times(LinearisedValve::Signature signature, double factor) {
  for (VectorXd& column : signature.column) column *= factor;
  signature.load *= factor;
  signature.absorbed *= factor;
  return signature;
}

/// Takes over what a simulation leaves, and what it lowers the cost by.
void keep_simulated(const LinearisedValve& fit, Stack residual, const VectorXd& at, double verified, LawFit& found) {
  found.verified = verified;
  found.consistent_verified =
      consistent_evidence(fit.error(), residual, verified, slowest_rows(fit.problem(), found.law, found.parameters));
  if (!(verified > 0)) return;
  found.simulated = std::move(residual);
  found.simulated_at = at;
}

/// The law in the place of what the valve's own parameters had to do for it: a delay in that of the valve's delay. Only
/// the distance from good valves tells of it. In proportion to a very small effect, for a large one looks like nothing
/// the valve's parameters can do unless they move with it.
void try_in_place_of_own(Search& search, const LinearisedValve& fit, const std::vector<double>& start, LawFit& found) {
  const Mechanism& law = *found.law.law;
  const std::size_t at = law.size_parameter;
  if (!std::isfinite(law.neutral) || at >= found.law.shared()) return;
  std::vector<double> small = search.clamped(start);
  double step = std::copysign(search.step(at), small[at] - law.neutral);
  small[at] = law.neutral + step;
  LinearisedValve::Signature effect = search.effect(search.clamped(small));
  if (fit.against_error(effect) < 0 && found.law.lower[at] < law.neutral) {
    step = -step;
    small[at] = law.neutral + step;
    effect = times(std::move(effect), -1);
  }
  const double power = fit.product(effect, effect), against = fit.against_error(effect);
  if (!(power > 0) || !(against > 0)) return;
  const double promise = against * against / power;
  if (promise < kLeastInPlace || promise < found.reduction) return;
  for (const double part : {1.0, 0.5}) {
    const double share = part * against / power;
    std::vector<double> parameters = small;
    parameters[at] = law.neutral + share * step;
    if (search.clamped(parameters) != parameters) continue;
    const VectorXd moved = fit.at() + fit.shift_without(times(effect, share));
    const double verified = fit.cost() - search.cost(moved, parameters);
    // What has been simulated is kept unless this does better; a mere forecast gives way to this one.
    if (!(verified > found.verified) && (part < 1 || found.verified > 0)) continue;
    found.parameters = found.shape = parameters;
    found.reduction = promise;
    found.baseline = moved;
    found.residual = search.residual(moved, parameters);
    found.simulated.clear();
    keep_simulated(fit, found.residual, moved, std::max(verified, 0.0), found);
    found.consistent_reduction = {promise, promise};
    if (verified > 0.5 * promise) break;
  }
}

/// The law at no effect; `tried` is where it has one.
LawFit nothing_found(const LinearisedValve& fit, const LawInFit& law, const Search& search, const Point& tried) {
  LawFit nothing{.law = law,
                 .parameters = std::vector<double>(law.shared() + law.own() * fit.error().size(), 0.0),
                 .shape = tried.parameters,
                 .freedoms = std::max<Index>(1, search.freedoms()),
                 .baseline = fit.at(),
                 .residual = fit.error()};
  for (std::size_t j = 0; j < law.shared(); ++j) nothing.parameters[j] = law.start[j];
  if (law.law->size_parameter < law.shared()) {
    const std::size_t at = law.law->size_parameter;
    nothing.parameters[at] = std::clamp(law.law->neutral, law.lower[at], law.upper[at]);
  }
  return nothing;
}

/// Down from one start.
Point descended(Search& search, const LinearisedValve& fit, const Mechanism& law, Point point, int most_steps) {
  Point proportional;
  proportional.parameters = search.clamped(scaled(point, fit, law));
  // An effect that is much too large has to shrink before differences tell anything.
  for (int halving = 0; halving < 4 && proportional.parameters != point.parameters; ++halving) {
    proportional.effect = search.effect(proportional.parameters);
    proportional.cost = fit.cost_without(proportional.effect);
    if (proportional.cost < point.cost) {
      point = std::move(proportional);
      break;
    }
    if (point.cost < 0 || law.size_parameter >= proportional.parameters.size()) break;
    double& size = proportional.parameters[law.size_parameter];
    size = law.neutral + 0.5 * (size - law.neutral);
  }
  double damping = 1e-3;
  constexpr double kSmallestGain = 0.05;  // of a cost in noise variances: far below what any decision turns on
  for (int step = 0; step < most_steps; ++step) {
    const double before = point.cost;
    if (!descend(search, fit, point, damping) || before - point.cost < kSmallestGain) break;
  }
  return point;
}

std::optional<LawFit> search_from_starts(Search& search, const LinearisedValve& fit, const LawInFit& law,
                                         const std::vector<std::vector<double>>& starts, int most_steps,
                                         double worthwhile) {
  // A law of many parameters, hunting, has valleys beside the right one that begin better.
  const std::size_t finalists = law.shared() >= kManyParameters ? kFinalists : 1;
  std::vector<Point> best = best_starts(search, fit, law, starts, finalists);
  if (best.empty()) return std::nullopt;
  if (best.front().promise < worthwhile) return nothing_found(fit, law, search, best.front());
  std::optional<Point> point;
  for (Point& start : best) {
    Point reached = descended(search, fit, *law.law, std::move(start), most_steps);
    if (!point || reached.cost < point->cost) point = std::move(reached);
  }
  if (!(point->cost < 0)) return nothing_found(fit, law, search, *point);
  LawFit found{.law = law,
               .parameters = point->parameters,
               .shape = point->parameters,
               .reduction = std::max(0.0, -point->cost),
               .freedoms = std::max<Index>(1, search.freedoms()),
               .baseline = fit.at() + fit.shift_without(point->effect),
               .residual = fit.residual_without(point->effect)};
  const Index slowest = slowest_rows(fit.problem(), law, found.parameters);
  found.consistent_reduction = consistent_evidence(fit.residual_alone(), found.residual, found.reduction, slowest);
  // A law that the valve could absorb shows a false gain where the valve's moves are only linear: simulate them.
  for (const double share : {1.0, 0.5}) {
    std::vector<double> parameters = found.parameters;
    const std::size_t size = law.law->size_parameter;
    if (share < 1 && (size >= law.shared() || !std::isfinite(law.law->neutral))) break;
    if (share < 1) parameters[size] = law.law->neutral + share * (parameters[size] - law.law->neutral);
    const VectorXd moved = fit.at() + share * (found.baseline - fit.at());
    const double verified = fit.cost() - search.cost(moved, parameters);
    if (verified > found.verified) keep_simulated(fit, search.residual(moved, parameters), moved, verified, found);
    if (found.verified > 0.5 * found.reduction) break;
  }
  return found;
}

}  // namespace

std::optional<LawFit> search_law(const LinearisedValve& fit, const ValveFitOptions& options, const LawInFit& law,
                                 const std::vector<std::vector<double>>& starts, int most_steps, double worthwhile) {
  Search search(fit, options, law);
  std::optional<LawFit> found = search_from_starts(search, fit, law, starts, most_steps, worthwhile);
  if (!found) return std::nullopt;
  if (options.prior && !starts.empty()) try_in_place_of_own(search, fit, starts.front(), *found);
  found->simulations = search.simulations();
  return found;
}

Index slowest_rows(const ValveFitProblem& problem, const LawInFit& law, const std::vector<double>& parameters) {
  const Mechanism& mechanism = *law.law;
  double slowest = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const Recording& recording = problem.recording(r);
    double samples = 0;
    if (mechanism.family == "slow" && !law.recording) samples = static_cast<double>(recording.samples());
    if (mechanism.cause == "periodic_disturbance") samples = 1 / (parameters.front() * recording.sample_period_s);
    slowest = std::max(slowest, samples);
  }
  return static_cast<Index>(std::ceil(slowest));
}

std::optional<double> upper_limit95(const LinearisedValve& fit, const ValveFitOptions& options, const LawFit& law,
                                    double inflation, double size_sd) {
  constexpr double kOneSided95 = 1.645;
  constexpr int kMostTrials = 6;
  const Mechanism& mechanism = *law.law.law;
  const std::size_t at = mechanism.size_parameter;
  if (at >= law.shape.size()) return std::nullopt;
  Search search(fit, options, law.law);
  const bool has_neutral = std::isfinite(mechanism.neutral);
  // Sizes by their share of the shape's: none at 0.
  const auto size_of = [&](double share) {
    return has_neutral ? mechanism.neutral + share * (law.shape[at] - mechanism.neutral) : law.shape[at] / share;
  };
  const auto effect_of = [&](double share) {
    std::vector<double> parameters = law.shape;
    parameters[at] = size_of(share);
    return search.effect(search.clamped(std::move(parameters)));
  };
  const LinearisedValve::Signature shape = effect_of(1);
  const double power = fit.product(shape, shape);
  if (!(power > kLeastEffect)) return std::nullopt;
  const double likeliest = std::max(0.0, fit.against_error(shape) / power);
  const double least = -likeliest * likeliest * power;
  // The colour of the noise makes samples tell less, not the population: what it knows is exact.
  const double by_samples = fit.told_by_samples(shape);
  const double tempered = by_samples / inflation + (power - by_samples);
  const double allowed = kOneSided95 * kOneSided95 * power / tempered;
  const auto is_within = [&](double share) {
    const double size = size_of(share);
    return size >= law.law.lower[at] && size <= law.law.upper[at];
  };
  double limit = likeliest + std::sqrt(allowed / power);
  double excess = 0;
  for (int trial = 0; trial < kMostTrials; ++trial) {
    if (!is_within(limit)) return std::nullopt;
    excess = fit.cost_without(effect_of(limit)) - least;
    if (excess >= allowed && excess <= 2 * allowed) break;
    // The excess grows with the square of the way, or slower while the law does not act yet.
    const double way = (limit - likeliest) * std::sqrt(1.2 * allowed / std::max(excess, 0.1 * allowed));
    limit = likeliest + way;
  }
  if (excess < allowed) return std::nullopt;
  if (!has_neutral) return size_of(limit);
  const double unit = law.shape[at] - mechanism.neutral;
  const double way = std::hypot((limit - likeliest) * unit, kOneSided95 * size_sd);
  return mechanism.neutral + likeliest * unit + std::copysign(way, unit);
}

}  // namespace valvetriage
