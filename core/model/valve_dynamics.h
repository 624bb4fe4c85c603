#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "core/model/transfer_function.h"
#include "core/recording/intersample.h"

namespace valvetriage {

/// Dynamics of a valve's coil and spool, between current and the orifice's opening, static gain 1:
///
///   G(s) = e^(−s delay) / ((s/ωn)² + 2 ζ s/ωn + 1) / Π (τ_i s + 1)
///
/// ζ > 1 gives two real lags, so order 2 covers both; each entry of `lag_s` adds one. Every parameter is positive, so
/// the model is stable by construction, and smooth in ln ωn, ln ζ and ln τ.
struct ValveDynamics {
  double delay_s = 0;                  ///< ≥ 0 [s]
  double natural_frequency_rad_s = 0;  ///< ωn > 0 [rad/s]
  double damping_ratio = 1;            ///< ζ > 0
  std::vector<double> lag_s;           ///< τ_i > 0 [s]

  int order() const { return 2 + static_cast<int>(lag_s.size()); }
  bool operator==(const ValveDynamics&) const = default;
};

TransferFunction to_transfer_function(const ValveDynamics& dynamics);
/// Back again: the first two poles are the pair, the others lags. Empty for anything that is no such chain.
std::optional<ValveDynamics> to_valve_dynamics(const TransferFunction& g);

/// ValveDynamics brought to a sampling period, exact for an IntervalSignal delayed by any fraction of a sample.
///
///   X_{i+1} = A X_i + g0 start_{m−1} + g1 end_{m−1} + g2 start_m + g3 end_m,   m = i − whole_delay,   y_i = X_i[last]
///
/// where the interval [t_i, t_{i+1}] sees the tail of input interval m−1 and the head of m. Before the first sample the
/// input is held at start[0].
class SampledValveDynamics {
 public:
  static constexpr int kMaxOrder = 5;
  using State = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxOrder, 1>;
  using Transition = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxOrder, kMaxOrder>;

  /// sample_period_s > 0
  SampledValveDynamics(const ValveDynamics& dynamics, double sample_period_s);

  int order() const { return static_cast<int>(transition_.rows()); }
  std::size_t whole_delay() const { return whole_delay_; }
  const Transition& transition() const { return transition_; }
  const State& gain(int k) const { return gains_[k]; }  ///< g0 to g3
  const State& steady() const { return steady_; }       ///< state at rest under a unit input

  /// Free run from steady state at the first input. out: as many values as input.start. Cost O(n · order²)
  void run(const IntervalSignal& input, std::span<double> out) const;

 private:
  template <int kOrder>
  void run_order(const IntervalSignal& input, std::span<double> out) const;

  Transition transition_;
  State gains_[4];
  State steady_;
  std::size_t whole_delay_ = 0;
};

}  // namespace valvetriage
