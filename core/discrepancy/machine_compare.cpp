#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "core/statistics/distributions.h"

#include "core/discrepancy/machine_search.h"
#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;

constexpr int kWhiteningOrder = 3;

double log_factorial(std::size_t n) {
  return std::lgamma(static_cast<double>(n) + 1);
}

/// e_t = Σ a_k e_{t−k}, least squares over all groups.
Eigen::VectorXd prediction_of(const std::vector<std::vector<double>>& gaps) {
  Eigen::MatrixXd square = Eigen::MatrixXd::Zero(kWhiteningOrder, kWhiteningOrder);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(kWhiteningOrder);
  for (const auto& group : gaps) {
    for (std::size_t t = kWhiteningOrder; t < group.size(); ++t) {
      Eigen::VectorXd past(kWhiteningOrder);
      for (int k = 0; k < kWhiteningOrder; ++k) past[k] = group[t - 1 - static_cast<std::size_t>(k)];
      if (!past.allFinite()) return right;
      square += past * past.transpose();
      right += group[t] * past;
    }
  }
  square.diagonal().array() += 1e-9 * square.trace() + 1e-300;
  return solve_symmetric(square, right);
}

std::vector<double> whitened_log_rms(const std::vector<std::vector<double>>& gaps, const Eigen::VectorXd& prediction) {
  std::vector<double> log_rms;
  for (const auto& group : gaps) {
    double squares = 0, count = 0;
    for (std::size_t t = kWhiteningOrder; t < group.size(); ++t) {
      double e = group[t];
      for (int k = 0; k < kWhiteningOrder; ++k) e -= prediction[k] * group[t - 1 - static_cast<std::size_t>(k)];
      squares += e * e;
      count += 1;
    }
    log_rms.push_back(std::isfinite(squares) ? 0.5 * std::log(squares / std::max(count, 1.0) + 1e-18) : 20);
  }
  return log_rms;
}

/// Rms over groups of so many samples each.
double pooled(const std::vector<double>& log_rms, const std::vector<std::vector<double>>& groups) {
  double squares = 0, samples = 0;
  for (std::size_t g = 0; g < log_rms.size(); ++g) {
    const auto n = g < groups.size() ? static_cast<double>(groups[g].size()) : 1;
    squares += n * std::exp(2 * log_rms[g]);
    samples += n;
  }
  return std::sqrt(squares / samples);
}

}  // namespace

double held_out_rms(const MachineScore& score) {
  return pooled(score.log_rms, score.gaps);
}

double black_box_held_out_rms(const MachineSearch& search) {
  return pooled(search.black_box_log_rms, search.linear.gaps);
}

double sign_test(const std::vector<double>& better, const std::vector<double>& worse) {
  const std::size_t n = std::min(better.size(), worse.size());
  if (n == 0) return 1;
  std::size_t wins = 0;
  for (std::size_t i = 0; i < n; ++i) wins += better[i] < worse[i] ? 1 : 0;
  // P(at least so many heads of n), one by one.
  double tail = 0;
  for (std::size_t k = wins; k <= n; ++k) {
    tail +=
        std::exp(log_factorial(n) - log_factorial(k) - log_factorial(n - k) - static_cast<double>(n) * std::log(2.0));
  }
  return std::min(1.0, 2 * tail);
}

BlockComparison compare_blocks(const std::vector<double>& better, const std::vector<double>& worse) {
  const std::size_t groups = std::min(better.size(), worse.size());
  BlockComparison comparison;
  if (groups == 0) return comparison;
  const auto n = static_cast<double>(groups);
  for (std::size_t i = 0; i < groups; ++i) comparison.log_gain += (worse[i] - better[i]) / n;
  comparison.p_value = sign_test(better, worse);
  if (groups < 3) return comparison;
  double squares = 0;
  for (std::size_t i = 0; i < groups; ++i) squares += std::pow(worse[i] - better[i] - comparison.log_gain, 2);
  const double t = comparison.log_gain / std::sqrt(squares / (n - 1) / n + 1e-12);
  const double by_size = 2 * student_t_upper_tail(n - 1, std::max(0.0, t));
  comparison.p_value = std::min(1.0, 2 * std::min(comparison.p_value, by_size));
  return comparison;
}

BlockComparison compare_whitened(const MachineScore& better, const MachineScore& worse) {
  const Eigen::VectorXd prediction = prediction_of(better.gaps);
  return compare_blocks(whitened_log_rms(better.gaps, prediction), whitened_log_rms(worse.gaps, prediction));
}

}  // namespace valvetriage
