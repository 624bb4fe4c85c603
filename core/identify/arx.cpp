#include "core/identify/arx.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/identify/triangular_factor.h"
#include "core/recording/same_rate.h"

namespace valvetriage {
namespace {

using Eigen::Index;

/// [−y(t−1) … , u(t−k) … , y(t)] where all of it is valid, the recording's mean taken off each column.
Eigen::MatrixXd regression_rows(const Recording& recording, const OutputErrorStructure& s) {
  const auto& u = recording.input.values;
  const auto& y = recording.output.values;
  const auto past = static_cast<std::size_t>(std::max(s.order, s.delay_samples + s.zeros));
  const Index p = s.order + s.zeros + 2;
  Eigen::MatrixXd rows(y.size() > past ? static_cast<Index>(y.size() - past) : 0, p);
  Index used = 0;
  std::size_t valid_run = 0;
  for (std::size_t t = 0; t < y.size(); ++t) {
    valid_run = recording.is_valid(t) ? valid_run + 1 : 0;
    if (valid_run <= past) continue;
    Index column = 0;
    for (int j = 1; j <= s.order; ++j) rows(used, column++) = -y[t - static_cast<std::size_t>(j)];
    for (int i = 0; i <= s.zeros; ++i) rows(used, column++) = u[t - static_cast<std::size_t>(s.delay_samples + i)];
    rows(used++, column) = y[t];
  }
  rows.conservativeResize(used, p);
  if (used > 0) rows.rowwise() -= rows.colwise().mean().eval();
  return rows;
}

bool moves(const Recording& recording) {
  const auto& u = recording.input.values;
  std::size_t first = 0;
  while (first < u.size() && !recording.is_valid(first)) ++first;
  for (std::size_t t = first; t < u.size(); ++t) {
    if (recording.is_valid(t) && u[t] != u[first]) return true;
  }
  return false;
}

Error bad_structure(const char* field, int value, int least, int most) {
  Error error{.code = "bad_option"};
  error.field = field;
  error.found = fmt::to_string(value);
  error.expected = fmt::format("a whole number from {} to {}", least, most);
  error.message = fmt::format("{} must be {}, not {}", field, error.expected, value);
  return error;
}

}  // namespace

Result<void> check_structure(const OutputErrorStructure& s) {
  constexpr int kMostDelay = 100000;  // samples; more than any recording has to spare
  if (s.order < 1 || s.order > kMaxIdentifiedOrder) {
    return tl::unexpected(bad_structure("order", s.order, 1, kMaxIdentifiedOrder));
  }
  if (s.zeros < 0 || s.zeros > s.order) return tl::unexpected(bad_structure("zeros", s.zeros, 0, s.order));
  if (s.delay_samples < 0 || s.delay_samples > kMostDelay) {
    return tl::unexpected(bad_structure("delay", s.delay_samples, 0, kMostDelay));
  }
  return {};
}

Result<ArxFit> fit_arx(std::span<const Recording* const> recordings, const OutputErrorStructure& structure) {
  if (const auto checked = check_structure(structure); !checked) return tl::unexpected(checked.error());
  if (recordings.empty()) return fail("no_samples", "there is no recording to identify from");
  const Index p = structure.order + structure.zeros + 1;
  Eigen::MatrixXd stack = Eigen::MatrixXd::Zero(static_cast<Index>(recordings.size()) * (p + 1), p + 1);
  Index rows = 0;
  bool input_moves = false;
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    if (!have_same_rate(*recordings[r], *recordings.front())) {
      return fail("sample_time_differs", "the recordings are not sampled at one rate");
    }
    const Eigen::MatrixXd regression = regression_rows(*recordings[r], structure);
    rows += regression.rows();
    input_moves = input_moves || moves(*recordings[r]);
    stack.middleRows(static_cast<Index>(r) * (p + 1), p + 1) = triangular_factor(regression);
  }
  const Index freedom = rows - p - static_cast<Index>(recordings.size());
  if (freedom < 1) {
    return fail("too_few_samples", fmt::format("{} usable rows do not determine {} parameters", rows, p));
  }
  if (!input_moves) return fail("constant_input", "the input is constant: nothing tells how the output follows it");

  const Eigen::MatrixXd R = triangular_factor(stack);
  ArxFit fit;
  fit.structure = structure;
  fit.rows = static_cast<std::size_t>(rows);
  Index rank = 0;
  const Eigen::VectorXd theta = solve_least_squares(R.leftCols(p), R.col(p), &rank);
  fit.full_rank = rank == p;
  fit.noise_variance = (R.leftCols(p) * theta - R.col(p)).squaredNorm() / static_cast<double>(freedom);
  const Eigen::MatrixXd covariance = fit.noise_variance * inverse_information(R.topLeftCorner(p, p));

  const Index order = structure.order;
  fit.coefficients.domain = Domain::kZ;
  fit.coefficients.sample_time_s = recordings.front()->sample_period_s;
  fit.coefficients.delay_samples = structure.delay_samples;
  fit.coefficients.a.assign(1, 1.0);
  fit.coefficients.a.insert(fit.coefficients.a.end(), theta.begin(), theta.begin() + order);
  fit.coefficients.b.assign(theta.begin() + order, theta.end());
  const Eigen::VectorXd errors = covariance.diagonal().cwiseMax(0).cwiseSqrt();
  fit.std_errors.a.assign(1, 0.0);
  fit.std_errors.a.insert(fit.std_errors.a.end(), errors.begin(), errors.begin() + order);
  fit.std_errors.b.assign(errors.begin() + order, errors.end());

  // G(1) = Σb / Σa; its gradient is −G / Σa along each a, 1 / Σa along each b.
  const double denominator = 1 + theta.head(order).sum();
  fit.static_gain = theta.tail(p - order).sum() / denominator;
  Eigen::VectorXd gradient = Eigen::VectorXd::Constant(p, 1 / denominator);
  gradient.head(order).setConstant(-fit.static_gain / denominator);
  fit.std_errors.static_gain = std::sqrt(std::max(0.0, gradient.dot(covariance * gradient)));
  return fit;
}

}  // namespace valvetriage
