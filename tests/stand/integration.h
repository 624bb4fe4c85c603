#pragma once

#include <algorithm>
#include <boost/numeric/odeint.hpp>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

namespace valvetriage::stand {

/// Tolerances of the adaptive integrator; states are scaled so that one figure serves all.
struct Tolerance {
  double absolute = 1e-6;
  double relative = 1e-6;
};

/// Adaptive Dormand-Prince steps of a model with memories. Where the command steps, or where one of the model's
/// switches changes sign, the instant is located on the dense output, the memories are updated and the integration
/// starts anew.
///
/// Model provides: State; rate(state, rate, t); next_step_s() and pass_step() for the steps of its command;
/// switch_count() and switch_value(i, state, t); remember(state, t) to update its memories at the end of a branch.
template <class Model>
class Integration {
 public:
  using State = typename Model::State;

  Integration(Model& model, const State& start, double start_s, const Tolerance& tolerance)
      : model_(model),
        stepper_(boost::numeric::odeint::make_dense_output(tolerance.absolute, tolerance.relative, kLongestStepS,
                                                           boost::numeric::odeint::runge_kutta_dopri5<State>())) {
    stepper_.initialize(start, start_s, kFirstStepS);
  }

  /// Integrates past the last of `times_s` and calls `take(state, t)` at each of them.
  template <class Take>
  void run(const std::vector<double>& times_s, Take take) {
    const auto rate = [this](const State& s, State& r, double t) { model_.rate(s, r, t); };
    State state;
    for (std::size_t next = 0; next < times_s.size();) {
      const auto [begin_s, reached_s] = stepper_.do_step(rate);
      const double step_s = model_.next_step_s();
      double stop_s = std::min(reached_s, step_s);
      for (int i = 0; i < model_.switch_count(); ++i) stop_s = switch_in(i, begin_s, stop_s).value_or(stop_s);
      for (; next < times_s.size() && times_s[next] <= stop_s; ++next) {
        stepper_.calc_state(times_s[next], state);
        take(state, times_s[next]);
      }
      stepper_.calc_state(stop_s, state);
      model_.remember(state, stop_s);
      if (stop_s == reached_s) continue;
      if (stop_s == step_s) model_.pass_step();
      stepper_.initialize(state, stop_s, kFirstStepS);
    }
  }

 private:
  static constexpr double kFirstStepS = 2e-4;
  static constexpr double kLongestStepS = 0.005;  // a command may have a kink at every sample

  /// Where in the last step a switch changes its sign, by bisection on the dense output.
  std::optional<double> switch_in(int index, double begin_s, double end_s) {
    constexpr double kNegligible = 1e-7;  // in the switch's own unit: a memory would not move by more
    State state;
    const auto value = [&](double t) {
      stepper_.calc_state(t, state);
      return model_.switch_value(index, state, t);
    };
    const double low = value(begin_s), high = value(end_s);
    if (low * high >= 0 || std::abs(low) < kNegligible || std::abs(high) < kNegligible) return std::nullopt;
    for (int i = 0; i < 25; ++i) {
      const double middle_s = 0.5 * (begin_s + end_s);
      (value(middle_s) * low > 0 ? begin_s : end_s) = middle_s;
    }
    return end_s;
  }

  using Stepper = decltype(boost::numeric::odeint::make_dense_output(
      1.0, 1.0, 1.0, boost::numeric::odeint::runge_kutta_dopri5<State>()));
  Model& model_;
  Stepper stepper_;
};

}  // namespace valvetriage::stand
