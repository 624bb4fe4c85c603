#include "core/identify/valve_fit_problem.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <ostream>
#include <string>
#include <tuple>

#include "core/identify/knot_curve.h"
#include "core/mechanisms/simulate_extended.h"
#include "tests/unit/identify/valves.h"

namespace valvetriage {
namespace {

ValveFitOptions options_at_105_psi(const std::vector<Recording>& recordings) {
  ValveFitOptions options;
  options.knots = *map_knots(recordings);
  options.reference_psi = 105;
  return options;
}

/// Recordings of a valve beside which a side channel moves.
std::vector<Recording> session_of(const test::MadeValve& valve) {
  std::vector<Recording> recordings = test::session(valve, 0.35, 11);
  for (Recording& recording : recordings) {
    Channel side{.name = "temperature_C", .unit = "C", .values = {}};
    for (std::size_t i = 0; i < recording.samples(); ++i) side.values.push_back(std::sin(0.7 * static_cast<double>(i)));
    recording.side.push_back(std::move(side));
  }
  return recordings;
}

/// A law of every place in the chain, large enough to be seen, in a valve with its dynamics ahead of its map or behind.
struct PutIn {
  const char* cause;
  std::vector<double> parameters;

  friend void PrintTo(const PutIn& put_in, std::ostream* out) { *out << put_in.cause; }
};
enum class Order { kSpoolThenMap, kMapThenMode };

class ValveFitProblemWith : public testing::TestWithParam<std::tuple<PutIn, Order>> {
 protected:
  const PutIn& put_in() const { return std::get<PutIn>(GetParam()); }
  test::MadeValve valve() const {
    return std::get<Order>(GetParam()) == Order::kMapThenMode ? test::with_a_mode() : test::MadeValve();
  }

  /// A law with these parameters, in every recording.
  static LawInFit law_with(const char* cause, const std::vector<double>& parameters) {
    const std::vector<double> step(parameters.size(), 1e-4);
    return {.law = find_mechanism(cause), .start = parameters, .lower = parameters, .upper = parameters, .step = step};
  }
};

TEST_P(ValveFitProblemWith, RunsFromItsLastLawOnAsFromTheStart) {
  const test::MadeValve valve = this->valve();
  const auto recordings = session_of(valve);
  ValveFitOptions options = options_at_105_psi(recordings);
  options.usual = valve.usual;
  const auto& [cause, parameters] = put_in();
  // Behind another law: what that one did is taken over.
  options.laws.push_back(law_with("gain_loss", {0.9}));
  ValveFitOptions wider = options;
  wider.laws.push_back(law_with(cause, parameters));
  const ValveFitProblem without(recordings, options), with(without, wider);
  const Eigen::VectorXd v = without.start_vector(valve.parameters);
  const std::size_t shared = parameters.size() - find_mechanism(cause)->own_per_recording;
  std::vector<double> of_each(parameters.begin(), parameters.begin() + static_cast<std::ptrdiff_t>(shared));
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    of_each.insert(of_each.end(), parameters.begin() + static_cast<std::ptrdiff_t>(shared), parameters.end());
  }
  const Eigen::VectorXd w = without.continued_in(with, v, of_each);

  std::vector<std::size_t> all(recordings.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  const auto behind = with.simulate_behind_last(w, all, without.all_runs(v));
  double moved = 0;
  for (const std::size_t r : all) {
    EXPECT_EQ(behind[r], with.simulate(w, r)) << r;
    const std::vector<double> plain = without.simulate(v, r);
    for (std::size_t i = 0; i < plain.size(); ++i) moved = std::max(moved, std::abs(behind[r][i] - plain[i]));
  }
  EXPECT_GT(moved, 0.1);
}

TEST_P(ValveFitProblemWith, IsAsAModelTheSameSimulation) {
  const test::MadeValve valve = this->valve();
  const auto recordings = session_of(valve);
  ValveFitOptions options = options_at_105_psi(recordings);
  options.usual = valve.usual;
  options.usual.gauge_lag_s = 0.004;
  options.laws.push_back(law_with("gain_loss", {0.9}));
  options.laws.push_back(law_with(put_in().cause, put_in().parameters));
  const ValveFitProblem problem(recordings, options);
  Eigen::VectorXd v = problem.start_vector(valve.parameters);
  for (std::size_t r = 0; r < recordings.size(); ++r) v.segment<ValveFitProblem::kStarts>(problem.own_at(r)).setZero();
  const Eigen::VectorXd knots = v.segment(ValveFitProblem::kParameters, problem.knots());
  const StaticMap map = KnotCurve(options.knots).through(std::vector<double>(knots.begin(), knots.end()));
  Model model = to_model(valve.parameters, map, options.usual);
  for (const LawInFit& law : options.laws) model.mechanisms.push_back({std::string(law.law->cause), law.start, ""});
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    const std::vector<double> fitted = problem.simulate(v, r);
    const auto simulated = simulate_extended(model, recordings[r], {});
    ASSERT_TRUE(simulated) << simulated.error().message;
    // A leaking volume begins where it settles, in a fit where a whole one would.
    for (std::size_t i = 200; i < fitted.size(); ++i) ASSERT_NEAR((*simulated)[i], fitted[i], 0.01) << r << ' ' << i;
  }
}

INSTANTIATE_TEST_SUITE_P(
    Places, ValveFitProblemWith,
    testing::Combine(testing::Values(PutIn{"hysteresis", {0.03, 0.1, 0}}, PutIn{"backlash", {0.02, 0, 0.5}},
                                     PutIn{"friction", {0.02, 0.012, 0.2, 0}}, PutIn{"transport_delay", {0.01}},
                                     PutIn{"extra_lag", {0.02, 1}}, PutIn{"extra_lag", {0.02, 0}},
                                     PutIn{"dead_band", {1.5, 0.05}}, PutIn{"static_curve", {0.1}},
                                     PutIn{"saturation", {150, -1000, 0}}, PutIn{"saturation", {150, -1000, 1}},
                                     PutIn{"leakage", {0.2}}, PutIn{"asymmetric_response", {1.5}},
                                     PutIn{"sensor_drift", {0.1}}, PutIn{"thermal_drift", {-0.05, 5, 0}},
                                     PutIn{"side_input", {2, 0.5, 0}}),
                     testing::Values(Order::kSpoolThenMap, Order::kMapThenMode)),
    [](const auto& put_in) { return std::string(std::get<PutIn>(put_in.param).cause) + std::to_string(put_in.index); });

TEST(ValveFitProblem, ALagThatIsFoundAfterASideInputDelaysTheValveAlone) {
  const test::MadeValve valve;
  const auto recordings = session_of(valve);
  const auto with_laws = [&](std::initializer_list<PutIn> laws) {
    ValveFitOptions options = options_at_105_psi(recordings);
    for (const auto& [cause, parameters] : laws) {
      const std::vector<double> step(parameters.size(), 1e-4);
      options.laws.push_back({find_mechanism(cause), parameters, parameters, parameters, step, {}, {}});
    }
    return options;
  };
  const PutIn side{"side_input", {2, 0.5, 0}}, lag{"extra_lag", {0.05, 0}};
  const ValveFitOptions of_lag = with_laws({lag}), of_side = with_laws({side}), of_both = with_laws({side, lag});
  const ValveFitProblem lagging(recordings, of_lag), sided(recordings, of_side), both(recordings, of_both);
  const Eigen::VectorXd at_both = both.start_vector(valve.parameters), at_side = sided.start_vector(valve.parameters);
  const std::vector<double> y = both.simulate(at_both, 0),
                            without = lagging.simulate(lagging.start_vector(valve.parameters), 0);
  const std::vector<std::size_t> first{0};
  EXPECT_EQ(both.simulate_behind_last(at_both, first, sided.all_runs(at_side)).front(), y);
  for (std::size_t i = 0; i < y.size(); ++i) {
    ASSERT_NEAR(y[i] - without[i], 2 * (recordings[0].side[0].values[i] - 0.5), 1e-9) << i;
  }
}

TEST(ValveFitProblem, ALawOnTheInputWithoutEffectChangesNothingBehindAMode) {
  const test::MadeValve valve = test::with_a_mode();
  const auto recordings = test::session(valve, 0.35, 11);
  ValveFitOptions options = options_at_105_psi(recordings);
  options.usual = valve.usual;
  ValveFitOptions wider = options;
  const std::vector<double> none{0, 0.1, 0};
  wider.laws.push_back(
      {.law = find_mechanism("hysteresis"), .start = none, .lower = none, .upper = none, .step = {1e-4, 1e-4, 1e-4}});
  const ValveFitProblem without(recordings, options), with(without, wider);
  const Eigen::VectorXd v = without.start_vector(valve.parameters);
  const Eigen::VectorXd w = with.start_vector(valve.parameters);
  const std::vector<double> plain = without.simulate(v, 0), same = with.simulate(w, 0);
  for (std::size_t i = 0; i < plain.size(); ++i) ASSERT_NEAR(same[i], plain[i], 1e-9) << i;
}

TEST(ValveFitProblem, ItsRowsAreTheSlopesOfItsRunsBehindAMode) {
  const test::MadeValve valve = test::with_a_mode();
  const auto recordings = test::session(valve, 0.35, 11);
  ValveFitOptions options = options_at_105_psi(recordings);
  options.usual = valve.usual;
  options.usual.gauge_lag_s = 0.004;
  options.laws.push_back(
      {.law = find_mechanism("asymmetric_response"), .start = {1.3}, .lower = {0.5}, .upper = {2}, .step = {1e-4}});
  const ValveFitProblem problem(recordings, options);
  Eigen::VectorXd v = problem.start_vector(valve.parameters);
  // Off its rest at the start, in both of the mode's states.
  const Eigen::Index own = problem.own_at(0);
  v(own) = 0.01;
  v(own + 1) = 0.02;
  const auto rows = problem.rows(v, 0);
  const double per_psi = std::sqrt(problem.inverse_variance(0));
  const auto expect_slope = [&](Eigen::Index entry, Eigen::Index column, double step) {
    Eigen::VectorXd above = v, below = v;
    above(entry) += step;
    below(entry) -= step;
    const std::vector<double> high = problem.simulate(above, 0), low = problem.simulate(below, 0);
    const Eigen::VectorXd told = rows.jacobian.times(Eigen::VectorXd::Unit(problem.shared() + problem.own(), column));
    double largest = 0, off = 0;
    for (std::size_t i = 0; i < rows.sample.size(); ++i) {
      const double slope = per_psi * (high[rows.sample[i]] - low[rows.sample[i]]) / (2 * step);
      largest = std::max(largest, std::abs(slope));
      off = std::max(off, std::abs(slope - told(static_cast<Eigen::Index>(i))));
    }
    EXPECT_GT(largest, 0) << column;
    EXPECT_LT(off, 0.01 * largest) << column;
  };
  for (const Eigen::Index j : {ValveFitProblem::kFrequency, ValveFitProblem::kDamping, ValveFitProblem::kTimeConstant,
                               ValveFitProblem::kExponent, ValveFitProblem::kSupply}) {
    expect_slope(j, j, 1e-4);
  }
  expect_slope(ValveFitProblem::kDelay, ValveFitProblem::kDelay, 1e-5);
  const Eigen::Index ratio = problem.law_entry(0, 0, 0);
  expect_slope(ratio, ratio, 1e-4);
  for (const Eigen::Index knot : {0, 2}) {
    expect_slope(ValveFitProblem::kParameters + knot, ValveFitProblem::kParameters + knot, 1e-3);
  }
  for (const Eigen::Index start : {0, 1}) expect_slope(own + start, problem.shared() + start, 1e-4);
}

TEST(ValveFitProblem, AKnotThatFewSamplesTellGivesWayToOneThatManyTell) {
  const test::MadeValve valve;
  const auto recordings = test::session(valve, 0.35, 11);
  const ValveFitOptions options = options_at_105_psi(recordings);
  const ValveFitProblem problem(recordings, options);
  const Eigen::VectorXd samples = problem.samples_at_knots();
  std::size_t valid = 0;
  for (const Recording& r : recordings) {
    for (std::size_t i = 0; i < r.samples(); ++i) valid += r.is_valid(i);
  }
  EXPECT_DOUBLE_EQ(samples.sum(), static_cast<double>(valid));

  // The first knot is put above its neighbour.
  Eigen::VectorXd v = problem.start_vector(valve.parameters);
  const Eigen::Index first = ValveFitProblem::kParameters;
  const double above = 0.5 * (v(first + 2) - v(first + 1));
  v(first) = v(first + 1) + above;
  const Eigen::VectorXd rising = problem.rising_map(v);
  EXPECT_NEAR(rising(0), v(first + 1) + above * samples(0) / (samples(0) + samples(1)), 1e-6);
  EXPECT_DOUBLE_EQ(rising(1), rising(0));
  EXPECT_TRUE(rising.tail(rising.size() - 2).isApprox(v.segment(first + 2, problem.knots() - 2)));
}

TEST(Descent, IsGivenUpWhereItDoesNotSeemToComeDownToWhatMatters) {
  const test::MadeValve valve;
  const auto recordings = test::session(valve, 0.35, 11);
  const ValveFitOptions options = options_at_105_psi(recordings);
  const ValveFitProblem problem(recordings, options);
  ValveParameters slow = valve.parameters;
  slow.volume.time_constant_s *= 1.5;
  const Descent start = descent_from(problem, problem.start_vector(slow));
  const Descent whole = descend_on(problem, start, 40);
  ASSERT_LT(whole.cost, 0.1 * start.cost);

  const Descent reaches = descend_on(problem, start, 40, 1e-7, 1.01 * whole.cost);
  EXPECT_EQ(reaches.termination, whole.termination);
  EXPECT_EQ(reaches.cost, whole.cost);

  const Descent falls_short = descend_on(problem, start, 40, 1e-7, 0.9 * whole.cost);
  EXPECT_EQ(falls_short.termination, FitTermination::kGivenUp);
  EXPECT_LT(falls_short.iterations, whole.iterations);
  EXPECT_EQ(descend_on(problem, falls_short, 40).iterations, falls_short.iterations) << "once given up it stays so";
}

}  // namespace
}  // namespace valvetriage
