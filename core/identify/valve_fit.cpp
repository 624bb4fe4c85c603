#include "core/identify/valve_fit.h"

#include <fmt/format.h>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/identify/valve_fit_problem.h"
#include "core/linear_algebra/solve.h"
#include "core/residual/fit_figures.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kKnotSpacing_a = 0.025;
// Constants in A are those of valves that are played over this much or more; smaller ones are alike in shares of it.
constexpr double kFullSpan_a = 1.0;
constexpr double kBeyondEnd = 0.25;  // of a spacing

constexpr double kFirstDamping = 1e-3, kLeastDamping = 1e-9;
// From one width of differences to the next.
constexpr double kNarrower = 5;
// A fit gains no more than this many times what its linear model forecasts.
constexpr double kMostOverForecast = 3;

/// A valve's second-order dynamics where they stand in valves of its type.
ValveParameters with_dynamics(const Mode& dynamics, double delay_s, const UsualMechanisms& usual) {
  if (usual.prompt_spool_rad_s > 0) {
    return {.spool = {.delay_s = delay_s, .natural_frequency_rad_s = usual.prompt_spool_rad_s}, .mode = dynamics};
  }
  return {.spool = {.delay_s = delay_s,
                    .natural_frequency_rad_s = dynamics.natural_frequency_rad_s,
                    .damping_ratio = dynamics.damping_ratio}};
}

/// Where the search begins: the population's mean, a given point, or a fan of speeds.
std::vector<ValveParameters> starting_points(const ValveFitOptions& options, std::span<const Recording> recordings) {
  if (options.prior) return {to_parameters(options.prior->mean, options.reference_psi, options.usual)};
  if (options.start) return {*options.start};
  const double period = recordings.front().sample_period_s;
  std::vector<ValveParameters> fan;
  for (const double samples : {4.0, 12.0, 40.0}) {
    ValveParameters start = with_dynamics({.natural_frequency_rad_s = 4.0 / (samples * period), .damping_ratio = 1.0},
                                          period, options.usual);
    start.loop_width_a = 0.002 * options.usual.current_scale;
    start.narrow_loop_width_a = 0.001 * options.usual.current_scale;
    start.volume = {.time_constant_s = samples * period, .exponent = 0.6, .supply_psi = 5 * options.reference_psi};
    fan.push_back(start);
    // Behind the map a mode and a volume change places without a bend between them.
    if (!start.mode) continue;
    start.volume.time_constant_s = period;
    fan.push_back(start);
  }
  return fan;
}

Descent best_descent(const ValveFitProblem& problem, const std::vector<ValveParameters>& fan, int most_iterations) {
  // Every start gets a few steps, the best of them the rest.
  constexpr int kScoutIterations = 5;
  Descent best{.cost = std::numeric_limits<double>::infinity()};
  for (const ValveParameters& start : fan) {
    Descent found = descend(problem, problem.start_vector(start), fan.size() > 1 ? kScoutIterations : most_iterations);
    if (found.cost < best.cost) best = std::move(found);
  }
  if (fan.size() > 1 && best.termination == FitTermination::kIterationLimit) {
    best = descend(problem, std::move(best.v), most_iterations);
  }
  return best;
}

Result<void> require_valve(std::span<const Recording> recordings, const ValveFitOptions& options) {
  if (recordings.empty()) return fail("no_recordings", "a valve cannot be fitted without a recording");
  if (options.knots.size() < 2) return fail("no_knots", "the static map needs at least two knots");
  if (!(options.reference_psi > 0)) {
    return fail("no_pressure", "the outputs of these recordings are never above 0 psi, so there is no valve to fit");
  }
  for (const Recording& recording : recordings) {
    if (recording.has_valve_units()) continue;
    return fail("units", fmt::format("'{}' is not in A and psi, so it cannot be fitted as a valve", recording.name));
  }
  return {};
}

/// Where the step a⁻¹ b leads from v, inside the bounds: what would leave them ends on them, and the rest is solved for
/// again with that held there. Clamping alone would leave the rest at the step that goes with a move nobody made.
VectorXd stepped_inside(const ValveFitProblem& problem, const VectorXd& v, const MatrixXd& a, const VectorXd& b) {
  constexpr int kMostPasses = 4;
  VectorXd there = v + solve_symmetric(a, b);
  std::vector<Index> held;
  for (int pass = 0; pass < kMostPasses; ++pass) {
    const VectorXd inside = problem.clamped(there);
    const std::size_t known = held.size();
    for (Index j = 0; j < v.size(); ++j) {
      if (inside(j) != there(j) && std::find(held.begin(), held.end(), j) == held.end()) held.push_back(j);
    }
    if (held.size() == known) return there;
    MatrixXd reduced = a;
    VectorXd wanted = b;
    for (const Index j : held) wanted -= a.col(j) * (inside(j) - v(j));
    for (const Index j : held) {
      reduced.row(j).setZero();
      reduced.col(j).setZero();
      reduced(j, j) = 1;
      wanted(j) = inside(j) - v(j);
    }
    there = v + solve_symmetric(reduced, wanted);
    for (const Index j : held) there(j) = inside(j);
  }
  return problem.clamped(there);
}

/// By how much the linear model says that the cost can fall, inside the bounds.
double forecast_gain(const ValveFitProblem& problem, const VectorXd& v, const ValveFitProblem::Normal& normal) {
  MatrixXd a = normal.a;
  a.diagonal() *= 1 + kLeastDamping;
  return normal.b.dot(stepped_inside(problem, v, a, normal.b) - v);
}

}  // namespace

Descent descent_from(const ValveFitProblem& problem, VectorXd v) {
  Descent descent{.cost = problem.cost(v), .damping = kFirstDamping, .width = problem.width_at(v)};
  descent.v = std::move(v);
  return descent;
}

Descent descend(const ValveFitProblem& problem, VectorXd v, int most_iterations, double smallest_gain) {
  return descend_on(problem, descent_from(problem, std::move(v)), most_iterations, smallest_gain);
}

Descent descend_on(const ValveFitProblem& problem, Descent descent, int most_iterations, double smallest_gain,
                   double to_reach) {
  constexpr int kMostAttempts = 8;
  if (descent.termination != FitTermination::kIterationLimit) return descent;
  for (int i = 0; i < most_iterations; ++i, ++descent.iterations) {
    const ValveFitProblem::Normal normal = problem.linearise(descent.v, descent.width);
    const double before = descent.cost;
    if (std::isfinite(to_reach) && before - kMostOverForecast * forecast_gain(problem, descent.v, normal) > to_reach) {
      descent.termination = FitTermination::kGivenUp;
      return descent;
    }
    for (int attempt = 0; attempt < kMostAttempts && descent.cost == before; ++attempt) {
      MatrixXd a = normal.a;
      a.diagonal() *= 1 + descent.damping;
      const VectorXd tried = stepped_inside(problem, descent.v, a, normal.b);
      const double cost = problem.cost(tried);
      if (std::isfinite(cost) && cost < before) {
        descent.v = tried;
        descent.cost = cost;
        descent.damping = std::max(descent.damping / 5, kLeastDamping);
      } else {
        descent.damping *= 8;
      }
    }
    if (!std::isfinite(descent.cost)) {
      descent.termination = FitTermination::kNoDescent;
      return descent;
    }
    if (before - descent.cost >= smallest_gain * before) continue;
    if (descent.width > 1) {
      descent.width = std::max(1.0, descent.width / kNarrower);
      descent.damping = kFirstDamping;
      continue;
    }
    descent.termination = descent.cost == before ? FitTermination::kNoDescent : FitTermination::kConverged;
    return descent;
  }
  return descent;
}

ValvePrior population_prior(VectorXd mean, MatrixXd covariance, double valves) {
  return {std::move(mean), (1 + 1 / valves) * covariance};
}

VectorXd to_vector(const ValveParameters& parameters) {
  const Mode dynamics =
      parameters.mode.value_or(Mode{parameters.spool.natural_frequency_rad_s, parameters.spool.damping_ratio});
  VectorXd v(static_cast<Index>(kValveParameters.size()));
  v << std::log(dynamics.natural_frequency_rad_s), std::log(dynamics.damping_ratio), parameters.spool.delay_s,
      parameters.loop_width_a, std::log(parameters.volume.time_constant_s), parameters.volume.exponent,
      std::log(parameters.volume.supply_psi), parameters.narrow_loop_width_a;
  return v;
}

ValveParameters to_parameters(const VectorXd& v, double reference_psi, const UsualMechanisms& usual) {
  ValveParameters parameters = with_dynamics({std::exp(v(0)), std::exp(v(1))}, v(2), usual);
  parameters.loop_width_a = v(3);
  parameters.narrow_loop_width_a = v(7);
  parameters.volume = {.time_constant_s = std::exp(v(4)),
                       .exponent = v(5),
                       .supply_psi = std::exp(v(6)),
                       .reference_psi = reference_psi,
                       .air_share = usual.air_share};
  return parameters;
}

void InputSpan::widen(std::span<const Recording> recordings) {
  for (const Recording& recording : recordings) {
    const auto [least, most] = std::minmax_element(recording.input.values.begin(), recording.input.values.end());
    low_a = std::min(low_a, *least);
    high_a = std::max(high_a, *most);
  }
}

double InputSpan::current_scale() const {
  return std::min(1.0, (high_a - low_a) / kFullSpan_a);
}

Result<std::vector<double>> map_knots(std::span<const Recording> recordings) {
  InputSpan span;
  span.widen(recordings);
  return map_knots(span);
}

Result<std::vector<double>> map_knots(const InputSpan& span) {
  if (!(span.high_a > span.low_a)) {
    return fail("constant_input", "the input of these recordings never changes, so no map can be learned");
  }
  const double spacing = kKnotSpacing_a * span.current_scale();
  // A knot that only noise and undershoot come near is not measured; the last piece reaches a little beyond its end.
  const auto first = std::llround(std::floor(span.low_a / spacing + kBeyondEnd));
  const auto last = std::max(first + 1, std::llround(std::ceil(span.high_a / spacing - kBeyondEnd)));
  std::vector<double> knots;
  for (auto k = first; k <= last; ++k) knots.push_back(static_cast<double>(k) * spacing);
  return knots;
}

double reference_pressure(std::span<const Recording> recordings) {
  double largest = 0;
  for (const Recording& recording : recordings) {
    for (std::size_t i = 0; i < recording.samples(); ++i) {
      if (recording.is_valid(i)) largest = std::max(largest, recording.output.values[i]);
    }
  }
  return 0.5 * largest;
}

Result<ValveFit> fit_valve(std::span<const Recording> recordings, const ValveFitOptions& options) {
  if (const auto valve = require_valve(recordings, options); !valve) return tl::unexpected(valve.error());
  const ValveFitProblem problem(recordings, options);
  Descent best = best_descent(problem, starting_points(options, recordings), options.most_iterations);
  if (best.v.size() == 0) return fail("no_fit", "no starting point simulates these recordings with finite pressures");

  ValveFit fit;
  fit.termination = best.termination;
  fit.iterations = best.iterations;
  const MatrixXd inverse = inverse_of_symmetric(problem.linearise(best.v).a);
  fit.covariance = inverse.topLeftCorner(problem.baseline_size(), problem.baseline_size());
  fit.vector = best.v;
  best.v.segment(ValveFitProblem::kParameters, problem.knots()) = problem.rising_map(best.v);
  fit.parameters = to_parameters(best.v.head(ValveFitProblem::kParameters), options.reference_psi, options.usual);
  for (std::size_t j = 0; j < fit.at_bound.size(); ++j) {
    fit.at_bound[j] = problem.is_at_bound(best.v, static_cast<Index>(j));
  }
  const VectorXd knots = best.v.segment(ValveFitProblem::kParameters, problem.knots());
  fit.map = {options.knots, std::vector<double>(knots.data(), knots.data() + knots.size())};

  double squares = 0, count = 0;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    fit.simulated.push_back(problem.simulate(best.v, r));
    const FitFigures figures = fit_figures(recordings[r].output.values, fit.simulated.back(), recordings[r].valid);
    squares += figures.rmse * figures.rmse * static_cast<double>(figures.samples);
    count += static_cast<double>(figures.samples);
  }
  fit.rmse = count > 0 ? std::sqrt(squares / count) : 0;
  return fit;
}

MagneticLoop loop_of(const ValveParameters& parameters, const UsualMechanisms& usual, double memory) {
  const double narrow = parameters.narrow_loop_width_a, wide = parameters.loop_width_a;
  MagneticLoop loop{.width_a = narrow + wide, .memory = memory};
  loop.reach = usual.current_scale;
  if (!(loop.width_a > 0)) return loop;
  loop.shares = usual.loop_shares;
  for (double& share : loop.shares) share *= wide / loop.width_a;
  loop.shares[0] += narrow / loop.width_a;
  return loop;
}

Model to_model(const ValveParameters& parameters, const StaticMap& map, const UsualMechanisms& usual) {
  Model model;
  model.kind = "valve";
  model.input_unit = "A";
  model.output_unit = "psi";
  model.loop = loop_of(parameters, usual);
  model.dynamics = to_transfer_function(parameters.spool);
  model.map = map;
  model.mode = parameters.mode;
  model.volume = parameters.volume;
  model.volume->air_share = usual.air_share;
  model.input_between = usual.input_between;
  if (usual.gauge_lag_s > 0) model.mechanisms.push_back({.cause = "extra_lag", .parameters = {usual.gauge_lag_s, 0}});
  return model;
}

UsualMechanisms usual_mechanisms(const Model& model) {
  UsualMechanisms usual{.input_between = model.input_between};
  if (model.loop) usual.current_scale = model.loop->reach;
  if (model.loop && model.loop->shares[0] < 1) {
    const double wide = 1 - model.loop->shares[0];
    for (std::size_t k = 1; k < usual.loop_shares.size(); ++k) usual.loop_shares[k] = model.loop->shares[k] / wide;
  }
  if (model.volume) usual.air_share = model.volume->air_share;
  if (const auto spool = to_valve_dynamics(model.dynamics); spool && model.mode) {
    usual.prompt_spool_rad_s = spool->natural_frequency_rad_s;
  }
  const bool has_gauge = !model.mechanisms.empty() && model.mechanisms.front().cause == "extra_lag";
  if (has_gauge) usual.gauge_lag_s = model.mechanisms.front().parameters.front();
  return usual;
}

}  // namespace valvetriage
