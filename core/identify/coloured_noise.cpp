#include "core/identify/coloured_noise.h"

#include <algorithm>
#include <cmath>

namespace valvetriage {

ColouredNoise fit_coloured_noise(const Eigen::VectorXd& residual, std::size_t count, std::size_t largest_order) {
  const auto n = static_cast<std::size_t>(residual.size());
  const std::size_t most = std::min(largest_order, count / 10);
  const double samples = static_cast<double>(std::max<std::size_t>(count, 1));
  std::vector<double> covariance(most + 1);
  for (std::size_t lag = 0; lag <= most; ++lag) {
    const auto length = static_cast<Eigen::Index>(n - lag);
    covariance[lag] = residual.head(length).dot(residual.tail(length)) / samples;
  }
  ColouredNoise best{.phi = {}, .innovation_variance = covariance[0]};
  if (!(covariance[0] > 0)) return best;
  double best_criterion = samples * std::log(covariance[0]);
  std::vector<double> phi;
  double variance = covariance[0];
  for (std::size_t order = 1; order <= most; ++order) {
    double reflection = covariance[order];
    for (std::size_t j = 0; j < phi.size(); ++j) reflection -= phi[j] * covariance[order - 1 - j];
    reflection /= variance;
    std::vector<double> next(order);
    for (std::size_t j = 0; j + 1 < order; ++j) next[j] = phi[j] - reflection * phi[order - 2 - j];
    next[order - 1] = reflection;
    phi = std::move(next);
    variance *= 1 - reflection * reflection;
    if (!(variance > 1e-14 * covariance[0])) break;
    const double criterion = samples * std::log(variance) + static_cast<double>(order) * std::log(samples);
    if (criterion < best_criterion) {
      best_criterion = criterion;
      best = {.phi = phi, .innovation_variance = variance};
    }
  }
  return best;
}

void colour_backwards(const ColouredNoise& noise, Eigen::MatrixXd& columns) {
  const auto order = static_cast<Eigen::Index>(noise.phi.size());
  if (order == 0) return;
  for (Eigen::Index c = 0; c < columns.cols(); ++c) {
    for (Eigen::Index t = columns.rows(); t-- > 0;) {
      double value = columns(t, c);
      for (Eigen::Index j = 1; j <= order && t + j < columns.rows(); ++j) {
        value += noise.phi[static_cast<std::size_t>(j - 1)] * columns(t + j, c);
      }
      columns(t, c) = value;
    }
  }
}

}  // namespace valvetriage
