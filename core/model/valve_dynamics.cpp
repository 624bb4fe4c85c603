#include "core/model/valve_dynamics.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>
#include <unsupported/Eigen/MatrixFunctions>

namespace valvetriage {
namespace {

using Matrix = Eigen::MatrixXd;
using Vector = Eigen::VectorXd;

/// Cascade of the pair (states: output, scaled derivative) and the lags; the last state of the cascade is the output.
struct StateSpace {
  Matrix a;
  Vector b;
};

StateSpace continuous_state_space(const ValveDynamics& dynamics) {
  const int n = dynamics.order();
  const double wn = dynamics.natural_frequency_rad_s;
  StateSpace system{Matrix::Zero(n, n), Vector::Zero(n)};
  // State 0 is the scaled derivative and state 1 the pair's output, so that the output is the last state at any order.
  system.a(0, 0) = -2 * dynamics.damping_ratio * wn;
  system.a(0, 1) = -wn;
  system.a(1, 0) = wn;
  system.b(0) = wn;
  for (int i = 2; i < n; ++i) {
    const double rate = 1.0 / dynamics.lag_s[static_cast<std::size_t>(i - 2)];
    system.a(i, i) = -rate;
    system.a(i, i - 1) = rate;
  }
  return system;
}

/// e^{Ah}, ∫ e^{A(h−τ)} B dτ and ∫ e^{A(h−τ)} B τ/T dτ over [0, h] from one exponential (Van Loan 1978).
struct Integrals {
  Matrix transition;
  Vector constant;
  Vector ramp;
};

Integrals integrate(const StateSpace& system, double h, double period) {
  const auto n = system.a.rows();
  Matrix augmented = Matrix::Zero(n + 2, n + 2);
  augmented.topLeftCorner(n, n) = system.a * h;
  augmented.block(0, n, n, 1) = system.b * h;
  augmented(n, n + 1) = h / period;
  const Matrix e = augmented.exp();
  return {e.topLeftCorner(n, n), e.block(0, n, n, 1), e.block(0, n + 1, n, 1)};
}

}  // namespace

TransferFunction to_transfer_function(const ValveDynamics& dynamics) {
  TransferFunction g{.domain = Domain::kS, .delay_s = dynamics.delay_s};
  const double wn = dynamics.natural_frequency_rad_s;
  const double zeta = dynamics.damping_ratio;
  const std::complex<double> spread = wn * std::sqrt(std::complex<double>(zeta * zeta - 1));
  g.poles = {-zeta * wn + spread, -zeta * wn - spread};
  g.gain = wn * wn;
  for (const double tau : dynamics.lag_s) {
    g.poles.emplace_back(-1.0 / tau);
    g.gain /= tau;
  }
  return g;
}

std::optional<ValveDynamics> to_valve_dynamics(const TransferFunction& g) {
  if (g.domain != Domain::kS || g.poles.size() < 2 || !g.zeros.empty()) return std::nullopt;
  ValveDynamics dynamics{.delay_s = g.delay_s, .natural_frequency_rad_s = std::sqrt(std::abs(g.poles[0] * g.poles[1]))};
  dynamics.damping_ratio = -(g.poles[0] + g.poles[1]).real() / (2 * dynamics.natural_frequency_rad_s);
  for (std::size_t i = 2; i < g.poles.size(); ++i) {
    if (g.poles[i].imag() != 0 || !(g.poles[i].real() < 0)) return std::nullopt;
    dynamics.lag_s.push_back(-1 / g.poles[i].real());
  }
  return dynamics;
}

SampledValveDynamics::SampledValveDynamics(const ValveDynamics& dynamics, double sample_period_s) {
  assert(sample_period_s > 0 && dynamics.order() <= kMaxOrder);
  const StateSpace system = continuous_state_space(dynamics);
  const double delay_samples = std::min(dynamics.delay_s / sample_period_s, kMostDelaySamples);
  whole_delay_ = static_cast<std::size_t>(delay_samples);
  const double f = delay_samples - static_cast<double>(whole_delay_);

  const Integrals tail = integrate(system, f * sample_period_s, sample_period_s);
  const Integrals head = integrate(system, (1 - f) * sample_period_s, sample_period_s);
  transition_ = head.transition * tail.transition;
  // Tail of interval m−1: the signal there is start + (end − start)(1 − f + τ/T).
  gains_[0] = head.transition * (f * tail.constant - tail.ramp);
  gains_[1] = head.transition * ((1 - f) * tail.constant + tail.ramp);
  gains_[2] = head.constant - head.ramp;
  gains_[3] = head.ramp;
  steady_ = Vector::Ones(system.a.rows());
  steady_(0) = 0;
}

template <int kOrder>
void SampledValveDynamics::run_order(const IntervalSignal& input, std::span<double> out) const {
  using Column = Eigen::Matrix<double, kOrder, 1>;
  const Eigen::Matrix<double, kOrder, kOrder> transition = transition_;
  const Column g0 = gains_[0], g1 = gains_[1], g2 = gains_[2], g3 = gains_[3];
  const double before = input.start[0];
  Column x = steady_ * before;
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = x(kOrder - 1);
    const bool has_head = i >= whole_delay_;
    const bool has_tail = i >= whole_delay_ + 1;
    const std::size_t m = has_head ? i - whole_delay_ : 0;
    // What does not wait for the state is summed beside it.
    Column driven = g0 * (has_tail ? input.start[m - 1] : before);
    driven += g1 * (has_tail ? input.end[m - 1] : before);
    driven += g2 * (has_head ? input.start[m] : before);
    driven += g3 * (has_head ? input.end[m] : before);
    x = transition.lazyProduct(x).eval() + driven;
  }
}

void SampledValveDynamics::run(const IntervalSignal& input, std::span<double> out) const {
  assert(input.start.size() >= out.size() && input.end.size() >= out.size());
  if (out.empty()) return;
  switch (order()) {
    case 2:
      return run_order<2>(input, out);
    case 3:
      return run_order<3>(input, out);
    case 4:
      return run_order<4>(input, out);
    default:
      assert(order() == kMaxOrder);
      return run_order<kMaxOrder>(input, out);
  }
}

}  // namespace valvetriage
