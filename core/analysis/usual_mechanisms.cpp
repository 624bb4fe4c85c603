#include "core/analysis/usual_mechanisms.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "core/discrepancy/linearised_valve.h"
#include "core/identify/valve_fit_problem.h"
#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Enough to tell the gauge from a spool, few enough to be quick.
constexpr std::size_t kMostValves = 3;
// A valve's worth of evidence above what one more parameter gives by chance once in a million.
constexpr double kEvidencePerParameter = 24;
constexpr int kMostSteps = 8;
constexpr int kRefitIterations = 3;
constexpr double kEnough = 1.0;  // of the cost, of all valves: nothing turns on it
constexpr double kLongestLag_samples = 4;
constexpr double kLargestAirShare = 10;  // nearly all of the capacity is air: more shows no difference

/// The shared parameters. The last share of the loop is what the others leave of 1.
enum Shared : Index { kGauge, kSecondShare, kThirdShare, kAir, kShared };

VectorXd vector_of(const UsualMechanisms& usual) {
  VectorXd u(static_cast<Index>(kShared));
  u << usual.gauge_lag_s, usual.loop_shares[1], usual.loop_shares[2], usual.air_share;
  return u;
}

UsualMechanisms usual_of(const VectorXd& u, const UsualMechanisms& beside) {
  const double last = std::max(0.0, 1 - u(kSecondShare) - u(kThirdShare));  // the others may make up 1 to rounding
  UsualMechanisms usual = beside;
  usual.gauge_lag_s = u(kGauge);
  usual.air_share = u(kAir);
  usual.loop_shares = {0, u(kSecondShare), u(kThirdShare), last};
  return usual;
}

constexpr std::array<Index, 2> kShares{kSecondShare, kThirdShare};

/// All valves with one setting of the shared parameters, each fitted beside it.
struct Setting {
  VectorXd shared;
  std::vector<VectorXd> own;  ///< fitted vector of each valve
  double cost = std::numeric_limits<double>::infinity();
};

class Learner {
 public:
  Learner(std::span<const ValveRecordings> valves, const ValveFitOptions& options, double sample_period_s)
      : options_(options), period_s_(sample_period_s) {
    for (const ValveRecordings& valve : valves) problems_.emplace_back(valve.recordings, options_);
  }

  /// Every valve fitted anew beside `shared`, from where `from` has it.
  Setting fitted(const VectorXd& shared, const std::vector<VectorXd>& from, int iterations) const {
    Setting setting{.shared = shared, .cost = 0};
    const ValveFitOptions options = with(shared);
    for (std::size_t i = 0; i < problems_.size(); ++i) {
      const ValveFitProblem problem(problems_[i], options);
      Descent descent = descend(problem, from[i], iterations, 1e-5);
      setting.own.push_back(std::move(descent.v));
      setting.cost += descent.cost;
    }
    return setting;
  }

  /// Gauss-Newton over the free ones of the shared parameters.
  Setting descend_shared(Setting setting, const std::vector<Index>& free) const {
    double damping = 1e-3;
    for (int step = 0; step < kMostSteps; ++step) {
      const Normal normal = linearise(setting, free);
      const double before = setting.cost;
      for (int attempt = 0; attempt < 4 && setting.cost == before; ++attempt) {
        MatrixXd a = normal.a;
        a.diagonal() *= 1 + damping;
        const VectorXd move = solve_symmetric(a, normal.b);
        VectorXd shared = setting.shared;
        for (std::size_t j = 0; j < free.size(); ++j) shared(free[j]) += move(static_cast<Index>(j));
        Setting tried = fitted(clamped(std::move(shared)), setting.own, kRefitIterations);
        if (tried.cost < before) {
          setting = std::move(tried);
          damping = std::max(damping / 10, 1e-6);
        } else {
          damping *= 10;
        }
      }
      if (before - setting.cost < kEnough) break;
    }
    return setting;
  }

 private:
  struct Normal {
    MatrixXd a;
    VectorXd b;
  };

  ValveFitOptions with(const VectorXd& shared) const {
    ValveFitOptions options = options_;
    options.usual = usual_of(shared, options_.usual);
    return options;
  }

  VectorXd clamped(VectorXd u) const {
    u(kGauge) = std::clamp(u(kGauge), 0.0, kLongestLag_samples * period_s_);
    u(kAir) = std::clamp(u(kAir), 0.0, kLargestAirShare);
    for (const Index j : kShares) u(j) = std::max(u(j), 0.0);
    // None of the shares is negative, the last neither.
    const double sum = u(kSecondShare) + u(kThirdShare);
    if (sum > 1) {
      for (const Index j : kShares) u(j) /= sum;
    }
    return u;
  }

  double step(Index j) const { return j == kGauge ? 0.01 * period_s_ : 0.01; }

  Normal linearise(const Setting& setting, const std::vector<Index>& free) const {
    const auto k = static_cast<Index>(free.size());
    Normal normal{MatrixXd::Zero(k, k), VectorXd::Zero(k)};
    const ValveFitOptions here = with(setting.shared);
    for (std::size_t i = 0; i < problems_.size(); ++i) {
      const ValveFitProblem problem(problems_[i], here);
      const LinearisedValve linear(problem, setting.own[i]);
      std::vector<LinearisedValve::Signature> slopes;
      for (const Index j : free) {
        VectorXd moved = setting.shared;
        moved(j) += step(j);
        const ValveFitOptions there = with(moved);
        const ValveFitProblem other(problems_[i], there);
        Stack column;
        for (std::size_t r = 0; r < other.recordings(); ++r) {
          column.push_back(linear.whitened(r, other.simulate(setting.own[i], r)) / step(j));
        }
        slopes.push_back(linear.signature(std::move(column)));
      }
      for (Index a = 0; a < k; ++a) {
        const auto& slope = slopes[static_cast<std::size_t>(a)];
        normal.b(a) += linear.against_error(slope);
        for (Index b = 0; b < k; ++b) normal.a(a, b) += linear.product(slope, slopes[static_cast<std::size_t>(b)]);
      }
    }
    return normal;
  }

  ValveFitOptions options_;
  double period_s_;
  std::vector<ValveFitProblem> problems_;
};

/// A mechanism that may be added: its parameters and where they begin.
struct Addition {
  std::vector<Index> parameters;
  std::vector<double> start;
};

}  // namespace

Result<UsualMechanisms> learn_usual_mechanisms(std::span<const ValveRecordings> valves, ValveFitOptions options) {
  const auto some = valves.first(std::min(valves.size(), kMostValves));
  const double period_s = some.front().recordings.front().sample_period_s;
  std::vector<VectorXd> own;
  for (const ValveRecordings& valve : some) {
    const auto fit = fit_valve(valve.recordings, options);
    if (!fit) return tl::unexpected(fit.error());
    if (!options.start) options.start = fit->parameters;
    own.push_back(fit->vector);
  }
  const Learner learner(some, options, period_s);
  Setting setting = learner.fitted(vector_of(options.usual), own, 0);
  const std::array<Addition, 3> additions{
      {{{kGauge}, {0.5 * period_s}}, {{kSecondShare, kThirdShare}, {1.0 / 3, 1.0 / 3}}, {{kAir}, {0.02}}}};
  std::vector<Index> free;
  for (const Addition& addition : additions) {
    VectorXd shared = setting.shared;
    std::vector<Index> tried = free;
    for (std::size_t j = 0; j < addition.parameters.size(); ++j) {
      shared(addition.parameters[j]) = addition.start[j];
      tried.push_back(addition.parameters[j]);
    }
    Setting with = learner.descend_shared(learner.fitted(shared, setting.own, kRefitIterations), tried);
    const double asked = kEvidencePerParameter * static_cast<double>(addition.parameters.size() * some.size());
    if (!(setting.cost - with.cost > asked)) continue;
    setting = std::move(with);
    free = std::move(tried);
  }
  return usual_of(setting.shared, options.usual);
}

}  // namespace valvetriage
