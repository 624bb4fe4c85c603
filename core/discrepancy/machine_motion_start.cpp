#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "core/discrepancy/machine_trials.h"
#include "core/linear_algebra/solve.h"
#include "core/model/machine.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSlow = 0.02;  // of the largest speed: slower, its sign is not to be trusted

/// A lag forwards and backwards: smooth without delay.
std::vector<double> smoothed(std::vector<double> x, double lag_samples) {
  const double keep = std::exp(-1 / lag_samples);
  double state = x.front();
  for (double& value : x) value = state = keep * state + (1 - keep) * value;
  state = x.back();
  for (auto value = x.rbegin(); value != x.rend(); ++value) *value = state = keep * state + (1 - keep) * *value;
  return x;
}

std::vector<double> rate_of(const std::vector<double>& x, double period_s) {
  std::vector<double> rate(x.size());
  for (std::size_t t = 1; t + 1 < x.size(); ++t) rate[t] = (x[t + 1] - x[t - 1]) / (2 * period_s);
  return rate;
}

double largest(const std::vector<double>& x) {
  double most = 0;
  for (const double value : x) most = std::max(most, std::abs(value));
  return most;
}

/// h of a loop along the way of its output, from none on.
std::vector<double> loop_along(const std::vector<double>& y, const LoopShape& shape) {
  std::vector<double> h(y.size());
  for (std::size_t t = 1; t < y.size(); ++t) h[t] = loop_after(h[t - 1], y[t] - y[t - 1], shape.beta, shape.delta);
  return h;
}

}  // namespace

std::optional<MotionEquation> motion_equation(const MachineData& data, const MotionTerms& terms, double lag_samples) {
  std::vector<bool> used{true, true, true, terms.stiffness, terms.coulomb, terms.cubic, terms.loop.has_value()};
  const auto columns = std::count(used.begin(), used.end(), true);
  MatrixXd square = MatrixXd::Zero(columns, columns);
  VectorXd right = VectorXd::Zero(columns);
  double squares = 0;
  for (const MachineRecord& record : data.records) {
    const auto margin = static_cast<std::size_t>(4 * lag_samples) + 2;
    if (record.input.size() < 4 * margin) continue;
    const auto u = smoothed(smoothed(record.input, lag_samples), lag_samples);
    const auto y = smoothed(smoothed(record.output, lag_samples), lag_samples);
    const auto speed = terms.shows_speed ? y : rate_of(y, data.period_s);
    const auto acceleration = rate_of(speed, data.period_s);
    const double slow = kSlow * largest(speed);
    std::vector<double> drag = speed, cube = y;
    for (double& v : drag) v = std::tanh(v / std::max(slow, 1e-300));
    for (double& z : cube) z = z * z * z;
    drag = smoothed(smoothed(std::move(drag), lag_samples), lag_samples);
    const std::vector<double> loop =
        terms.loop ? smoothed(smoothed(loop_along(y, *terms.loop), lag_samples), lag_samples) : y;
    for (std::size_t t = margin; t + margin < u.size(); ++t) {
      const double all[] = {u[t], -speed[t], 1, -y[t], -drag[t], -cube[t], -loop[t]};
      VectorXd row(columns);
      Index at = 0;
      for (std::size_t c = 0; c < used.size(); ++c) {
        if (used[c]) row[at++] = all[c];
      }
      square += row * row.transpose();
      right += acceleration[t] * row;
      squares += acceleration[t] * acceleration[t];
    }
  }
  const VectorXd scale = square.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const MatrixXd scaled = scale.asDiagonal() * square * scale.asDiagonal();
  const VectorXd solved = scale.cwiseProduct(least_squares(scaled, scale.cwiseProduct(right)));
  if (!solved.allFinite()) return {};
  MotionEquation equation{.gain = solved[0], .damping = solved[1], .bias = solved[2]};
  Index at = 3;
  if (terms.stiffness) equation.stiffness = solved[at++];
  if (terms.coulomb) equation.coulomb = solved[at++];
  if (terms.cubic) equation.cubic = solved[at++];
  if (terms.loop) equation.loop = solved[at++];
  equation.squares = std::max(0.0, squares - solved.dot(right));
  return equation;
}

}  // namespace valvetriage
