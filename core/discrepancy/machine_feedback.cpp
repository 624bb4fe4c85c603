#include "core/discrepancy/machine_feedback.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <vector>

#include "core/linear_algebra/solve.h"
#include "core/recording/feedback.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kKept = 0.75;        // of the samples: at the others the set-point may change
constexpr double kLawShare = 0.9;     // R² of a controller's law on the kept samples
constexpr double kForetold = 3;       // times the law's squares that the past alone must leave
constexpr double kIntegrating = 1.5;  // times the law's squares that a law without integral action must leave
constexpr Index kFewestMoves = 100;
constexpr double kMoving = 0.3;  // of the samples
constexpr int kConcentrations = 10;

/// Squares that a linear law leaves on the samples that follow it best: least trimmed squares (Rousseeuw 1984), by
/// concentration from the samples where the input moves least.
double trimmed_squares(const MatrixXd& columns, const VectorXd& values) {
  std::vector<Index> order(static_cast<std::size_t>(values.size()));
  std::iota(order.begin(), order.end(), Index{0});
  const auto kept = static_cast<std::ptrdiff_t>(kKept * static_cast<double>(order.size()));
  VectorXd gap = values;
  double squares = 0;
  for (int i = 0; i < kConcentrations; ++i) {
    std::nth_element(order.begin(), order.begin() + kept, order.end(), [&](Index a, Index b) {
      return std::abs(gap[a]) != std::abs(gap[b]) ? std::abs(gap[a]) < std::abs(gap[b]) : a < b;
    });
    MatrixXd square = MatrixXd::Zero(columns.cols(), columns.cols());
    VectorXd right = VectorXd::Zero(columns.cols());
    for (auto row = order.begin(); row != order.begin() + kept; ++row) {
      square += columns.row(*row).transpose() * columns.row(*row);
      right += values[*row] * columns.row(*row).transpose();
    }
    gap = values - columns * least_squares(square, right);
    squares = 0;
    for (auto row = order.begin(); row != order.begin() + kept; ++row) squares += gap[*row] * gap[*row];
  }
  return squares;
}

/// Squares of the kept values themselves, the same way.
double trimmed_total(const VectorXd& values) {
  std::vector<double> squares;
  for (const double v : values) squares.push_back(v * v);
  const auto kept = static_cast<std::ptrdiff_t>(kKept * static_cast<double>(squares.size()));
  std::nth_element(squares.begin(), squares.begin() + kept, squares.end());
  return std::accumulate(squares.begin(), squares.begin() + kept, 0.0);
}

/// Second differences of the input where it moves, and what may explain them.
struct Moves {
  VectorXd values;
  MatrixXd law;         ///< Δy_t, Δy_{t−1}, Δy_{t−2}
  MatrixXd unlevelled;  ///< Δ²y_t, Δ²y_{t−1}: the same without integral action
  MatrixXd past;        ///< Δy_{t−1}, Δy_{t−2}, Δy_{t−3}, and two past second differences of the input
};

Moves moves_of(const Recording& recording) {
  const auto& u = recording.input.values;
  const auto& y = recording.output.values;
  const auto second = [&](std::size_t t) { return u[t] - 2 * u[t - 1] + u[t - 2]; };
  const auto rate = [&](std::size_t t) { return y[t] - y[t - 1]; };
  std::vector<std::size_t> rows;
  for (std::size_t t = 4; t < u.size(); ++t) {
    if (second(t) != 0 && recording.is_valid(t) && recording.is_valid(t - 1) && recording.is_valid(t - 2) &&
        recording.is_valid(t - 3)) {
      rows.push_back(t);
    }
  }
  const auto n = static_cast<Index>(rows.size());
  Moves moves{VectorXd(n), MatrixXd(n, 3), MatrixXd(n, 2), MatrixXd(n, 5)};
  for (Index i = 0; i < n; ++i) {
    const std::size_t t = rows[static_cast<std::size_t>(i)];
    moves.values[i] = second(t);
    moves.law.row(i) << rate(t), rate(t - 1), rate(t - 2);
    moves.unlevelled.row(i) << rate(t) - rate(t - 1), rate(t - 1) - rate(t - 2);
    moves.past.row(i) << rate(t - 1), rate(t - 2), rate(t - 3), second(t - 1), second(t - 2);
  }
  return moves;
}

bool has_integrating_controller(const Recording& recording) {
  const Moves moves = moves_of(recording);
  if (moves.values.size() < kFewestMoves) return false;
  if (static_cast<double>(moves.values.size()) < kMoving * static_cast<double>(recording.samples())) return false;
  const double total = trimmed_total(moves.values);
  // What is exact to rounding leaves nothing to compare with.
  const double left = std::max(trimmed_squares(moves.law, moves.values), 1e-18 * total);
  return left < (1 - kLawShare) * total && trimmed_squares(moves.past, moves.values) > kForetold * left &&
         trimmed_squares(moves.unlevelled, moves.values) > kIntegrating * left;
}

}  // namespace

LoopSigns loop_signs(std::span<const Recording> recordings) {
  LoopSigns signs;
  for (const Recording& recording : recordings) {
    signs.input_follows_output = signs.input_follows_output || output_followed(recording).is_regulated();
    signs.integrating_controller = signs.integrating_controller || has_integrating_controller(recording);
  }
  return signs;
}

}  // namespace valvetriage
