#include "core/discrepancy/unnamed_account.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "core/discrepancy/valve_contest.h"
#include "core/statistics/distributions.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kAirProbe = 0.01;   // of the volume's capacity
constexpr double kOwnProbe = 0.05;   // of a standard deviation of good valves
constexpr double kIdleShare = 0.25;  // of a law's evidence: left to it beside a better account, it is idle
constexpr double kWorthAFit = 0.25;  // of a law's evidence, to first order: a smaller one does not overtake it
constexpr int kMoves = 6, kSteps = 12;

/// One thing that may differ from good valves: a parameter of the valve's own, or the air.
struct Account {
  std::optional<Index> parameter;

  std::string_view name() const {
    return parameter ? kValveParameters[static_cast<std::size_t>(*parameter)].name : "air in the fluid";
  }
  double probe(const ValvePrior& good) const {
    return parameter ? kOwnProbe * std::sqrt(good.covariance(*parameter, *parameter)) : kAirProbe;
  }
  /// Whether what good valves have, moved so far, is still a valve.
  bool allows(const Explanation& of, double move) const {
    return parameter ? !of.problem->leaves_bounds(of.v, *parameter, move) : of.options->usual.air_share + move >= 0;
  }
  /// An explanation's options with good valves that differ by so much.
  ValveFitOptions moved(const ValveFitOptions& options, double move) const {
    ValveFitOptions moved = options;
    if (parameter) {
      moved.prior->mean(*parameter) += move;
    } else {
      moved.usual.air_share += move;
    }
    return moved;
  }
  VectorXd moved(VectorXd v, double move) const {
    if (parameter) v(*parameter) += move;
    return v;
  }
};

std::vector<Account> accounts() {
  std::vector<Account> accounts{{}};
  for (Index j = 0; j < ValveFitProblem::kParameters; ++j) accounts.push_back({j});
  return accounts;
}

/// What a problem simulates that a fit does not, whitened.
Stack difference_of(const ValveFitProblem& problem, const VectorXd& v, const LinearisedValve& fit) {
  Stack difference;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    difference.push_back(fit.whitened(r, problem.simulate(v, r)));
  }
  return difference;
}

/// Whitened, per probe.
Stack effect_of(const Account& account, const Explanation& of, const LinearisedValve& linear) {
  const double probe = account.probe(*of.options->prior);
  const ValveFitOptions options = account.moved(*of.options, probe);
  return difference_of(ValveFitProblem(*of.problem, options), account.moved(of.v, probe), linear);
}

/// What a signature would take off the cost.
double evidence_of(const LinearisedValve& fit, const LinearisedValve::Signature& signature) {
  const double error = fit.against_error(signature), information = fit.product(signature, signature);
  return information > 0 ? error * error / information : 0;
}

/// A fit that may move what good valves have as well.
struct Moved {
  Explanation fitted;
  double move = 0;
};

Explanation fitted_with(const Account& account, const Explanation& others, double move, const VectorXd& start) {
  Explanation fitted;
  fitted.options = std::make_unique<ValveFitOptions>(account.moved(*others.options, move));
  fitted.problem = std::make_unique<ValveFitProblem>(*others.problem, *fitted.options);
  Descent descent = descend(*fitted.problem, fitted.problem->clamped(start), kSteps);
  fitted.v = std::move(descent.v);
  fitted.cost = descent.cost;
  return fitted;
}

/// Newton's steps in the move, everything else fitted at each; as far as a valve allows.
Moved fitted_to(const Account& account, const Explanation& others, double worth) {
  Moved best{others.copy()};
  const double probe = account.probe(*others.options->prior);
  for (int step = 0; step < kMoves; ++step) {
    const LinearisedValve linear(*best.fitted.problem, best.fitted.v);
    const auto effect = linear.signature(effect_of(account, best.fitted, linear));
    const double by = probe * linear.against_error(effect) / linear.product(effect, effect);
    const double move = best.move + by;
    if (!std::isfinite(by) || !account.allows(others, move)) break;
    Explanation next = fitted_with(account, others, move, account.moved(best.fitted.v, by));
    if (!(next.cost < best.fitted.cost)) break;
    const double gained = best.fitted.cost - next.cost;
    best = {std::move(next), move};
    if (gained < worth) break;
  }
  return best;
}

}  // namespace

std::optional<Finding> unnamed_account(const Explanation& explanation, const LinearisedValve& with, std::size_t law,
                                       const Explanation& others, double inflation) {
  if (!others.options->prior) return {};
  const LinearisedValve alone(*others.problem, others.v);
  const Stack effect_of_law = difference_of(*explanation.problem, explanation.v, alone);
  const double least = kLeastEvidence * inflation;
  const double of_law = evidence_of(alone, alone.signature(effect_of_law));
  std::optional<Finding> best;
  double best_cost = explanation.cost - least;
  for (const Account& account : accounts()) {
    if (!(evidence_of(with, with.signature(effect_of(account, explanation, with))) > least)) continue;
    const double of_account = evidence_of(alone, alone.signature(effect_of(account, others, alone)));
    if (!(of_account > kWorthAFit * of_law)) continue;
    const Moved moved = fitted_to(account, others, least);
    if (!(moved.fitted.cost < best_cost)) continue;
    const LinearisedValve beside(*moved.fitted.problem, moved.fitted.v);
    if (!(evidence_of(beside, beside.signature(effect_of_law)) < kIdleShare * of_law)) continue;
    best_cost = moved.fitted.cost;
    const double statistic = std::copysign(std::sqrt((others.cost - best_cost) / inflation), moved.move);
    best = Finding{.what = fmt::format("{} {} good valves' explains more than {}", account.name(),
                                       moved.move > 0 ? "above" : "below", explanation.laws[law].law.law->cause),
                   .where = std::string(kOwnParameters),
                   .statistic = statistic,
                   .p_value = chi_squared_upper_tail(1, statistic * statistic),
                   .share_of_structured_residual = std::numeric_limits<double>::quiet_NaN()};
  }
  return best;
}

}  // namespace valvetriage
