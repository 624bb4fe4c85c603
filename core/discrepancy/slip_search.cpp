#include "core/discrepancy/slip_search.h"

#include <algorithm>
#include <boost/math/statistics/univariate_statistics.hpp>
#include <cmath>
#include <optional>
#include <utility>

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// Breakaway over the range of inputs, from what barely shows to what holds the spool over most of a staircase's steps.
constexpr double kLeastBreakaway = 0.004, kMostBreakaway = 0.15;
constexpr int kBreakaways = 14;
constexpr double kKineticShares[] = {0.5, 0.7, 0.9};
constexpr double kStribeckSpeeds[] = {0.05, 0.2, 0.6};  // ranges a second
constexpr std::size_t kFewestSlips = 3;                 // each way
constexpr std::size_t kFitted = 2;                      // of the grid, and of what the slips show
constexpr int kFirstFits = 2, kLastFits = 6, kSteps = 4;
constexpr double kLeastGain = 10;  // of the scale-free cost: an error 1 % smaller in 500 samples
constexpr double kSmallestGain = 1e-4;
constexpr Index kLawParameters = 4;
constexpr double kFirstStep = 0.06;
constexpr int kHalvings = 4;
// A search that creeps gains nothing that a decision turns on: a noise variance at least, and no new round after this
// many free runs.
constexpr double kWorthAStep = 1;
constexpr int kMostFreeRuns = 400;
// One slip ahead of the data is easier than a free run: what leaves this many times the mean square of another law's
// free run there will not catch up with it in its own (the margin of the comparison, 1.2 of the rms).
constexpr double kClearlyMore = 1.2 * 1.2;

using Parameters = std::vector<double>;

/// Breakaway and kinetic force as the slips of slow ramps show them. Up and down weigh alike, for the map may lie
/// beside its true place.
std::optional<std::pair<double, double>> forces_shown(const std::vector<Slip>& slips) {
  double breakaway = 0, kinetic = 0;
  for (const int direction : {-1, 1}) {
    std::vector<double> before, after;
    for (const Slip& slip : slips) {
      if (slip.direction != direction) continue;
      before.push_back(std::abs(slip.before_a));
      after.push_back(std::abs(slip.after_a));
    }
    if (before.size() < kFewestSlips) return std::nullopt;
    breakaway += 0.5 * boost::math::statistics::median(before);
    kinetic += 0.5 * boost::math::statistics::median(after);
  }
  return std::pair(breakaway, kinetic);
}

/// With each speed of a fall from breakaway to kinetic force.
std::vector<Parameters> with_speeds(double breakaway_a, double kinetic_a, double range_a) {
  std::vector<Parameters> points;
  for (const double speed : kStribeckSpeeds) points.push_back({breakaway_a, kinetic_a, speed * range_a, 0});
  return points;
}

std::vector<Parameters> grid(double range_a) {
  std::vector<Parameters> points;
  for (int i = 0; i < kBreakaways; ++i) {
    const double share = static_cast<double>(i) / (kBreakaways - 1);
    const double breakaway = range_a * kLeastBreakaway * std::pow(kMostBreakaway / kLeastBreakaway, share);
    for (const double kinetic : kKineticShares) {
      for (Parameters& point : with_speeds(breakaway, kinetic * breakaway, range_a)) points.push_back(std::move(point));
    }
  }
  return points;
}

struct Point {
  VectorXd v;
  double cost = 0;  ///< one slip ahead, see scale_free_cost
};

bool is_better(const Point& a, const Point& b) {
  return a.cost < b.cost;
}

/// A few fits in turn, each from the rests and the weights that the one before it leaves.
void fit_ahead(ValveFitProblem& problem, int fits, Point& point) {
  for (int fit = 0; fit < fits; ++fit) {
    problem.follow_rests(point.v);
    point.cost = problem.scale_free_cost(point.v);
    Point fitted{.v = descend(problem, point.v, kSteps, kSmallestGain).v};
    fitted.cost = problem.scale_free_cost(fitted.v);
    const double gained = point.cost - fitted.cost;
    if (gained > 0) point = std::move(fitted);
    if (!(gained > kLeastGain)) return;
  }
}

double samples_in(const ValveFitProblem& problem) {
  double samples = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    samples += static_cast<double>(problem.recording(r).valid_samples());
  }
  return samples;
}

/// The law's parameters alone, in free runs, by pattern search in their logarithms: where one slip more or less
/// decides, a difference over a small step says nothing. Source: Hooke, Jeeves, J. ACM 8 (1961) 212.
void search_free(const ValveFitProblem& problem, Point& point) {
  point.cost = problem.cost(point.v);
  int free_runs = 1;
  double step = kFirstStep;
  for (int halvings = 0; halvings < kHalvings; ++halvings, step *= 0.5) {
    for (bool improves = true; improves && free_runs < kMostFreeRuns;) {
      improves = false;
      for (Index entry = problem.shared() - kLawParameters; entry + 1 < problem.shared(); ++entry) {
        for (const double by : {std::exp(step), std::exp(-step)}) {
          Point tried = point;
          tried.v(entry) *= by;
          tried.v = problem.clamped(std::move(tried.v));
          tried.cost = problem.cost(tried.v);
          ++free_runs;
          if (!(tried.cost < point.cost - kWorthAStep)) continue;
          point = std::move(tried);
          improves = true;
          break;
        }
      }
    }
  }
}

/// A vector with the last law taken off again.
JointStart as_start(const ValveFitProblem& with_law, const ValveFitProblem& beside, const VectorXd& v,
                    std::size_t laws) {
  JointStart start{
      .baseline = VectorXd::Zero(beside.size()), .parameters = with_law.law_parameters(v, laws, 0), .width = 1};
  start.baseline.head(beside.shared()) = v.head(beside.shared());
  for (std::size_t r = 0; r < beside.recordings(); ++r) {
    start.baseline.segment(beside.own_at(r), beside.own()) = v.segment(with_law.own_at(r), beside.own());
  }
  return start;
}

}  // namespace

bool makes_stick(const LawInFit& law, const Explanation& beside) {
  if (!law.law->reshape || beside.problem->sticks(beside.v)) return false;
  ValveDynamics spool;
  OrificeVolume volume;
  SpoolFriction friction;
  law.law->reshape(law.upper, {spool, volume, friction});
  return friction.breakaway_a > 0;
}

std::vector<JointStart> slip_starts(const Explanation& beside, const LawInFit& law, const VectorXd& place,
                                    const Explanation& closest) {
  ValveFitOptions options = *beside.options;
  options.laws.push_back(law);
  // How the forces grow along the way shows once they are known.
  options.laws.back().step.back() = 0;
  ValveFitProblem problem(*beside.problem, options);
  const double range_a = options.knots.back() - options.knots.front();

  const VectorXd as_law = problem.clamped(beside.problem->continued_in(problem, place, law.lower));
  problem.follow_rests(as_law);
  std::vector<Point> points;
  const auto add_best_of = [&](const std::vector<Parameters>& candidates) {
    std::vector<Point> tried;
    for (const Parameters& parameters : candidates) {
      Point point{.v = problem.clamped(beside.problem->continued_in(problem, place, parameters))};
      point.cost = problem.scale_free_cost(point.v);
      if (std::isfinite(point.cost)) tried.push_back(std::move(point));
    }
    std::stable_sort(tried.begin(), tried.end(), is_better);
    if (tried.size() > kFitted) tried.resize(kFitted);
    for (Point& point : tried) points.push_back(std::move(point));
  };
  if (const auto forces = forces_shown(problem.slips(as_law))) {
    add_best_of(with_speeds(forces->first, forces->second, range_a));
  }
  add_best_of(grid(range_a));
  if (points.empty()) return {};
  for (Point& point : points) fit_ahead(problem, kFirstFits, point);
  std::stable_sort(points.begin(), points.end(), is_better);
  if (points.front().cost - closest.problem->scale_free_cost(closest.v) > samples_in(problem) * std::log(kClearlyMore))
    return {};
  fit_ahead(problem, kLastFits, points.front());
  std::vector<JointStart> starts;
  for (Point& point : points) {
    problem.follow_rests(point.v);
    point.v = problem.let_go(std::move(point.v));
    search_free(problem, point);
    starts.push_back(as_start(problem, *beside.problem, point.v, beside.options->laws.size()));
  }
  return starts;
}

}  // namespace valvetriage
