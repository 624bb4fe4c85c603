#include "core/residual/residual_signature.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/recording/segments.h"

namespace valvetriage {
namespace {

Eigen::RowVectorXd mean_of(const Eigen::MatrixXd& good) {
  if (good.rows() == 0) return Eigen::RowVectorXd::Zero(good.cols());
  const Eigen::ArrayXXd there = good.array().isFinite().select(good.array(), 0);
  const Eigen::ArrayXXd count = good.array().isFinite().cast<double>();
  return (there.colwise().sum() / count.colwise().sum().max(1)).matrix();
}

}  // namespace

BinnedResidual binned_residual(const Recording& recording, const std::vector<double>& simulated, std::size_t bins) {
  const std::size_t n = recording.samples();
  bins = std::clamp<std::size_t>(bins, 1, std::max<std::size_t>(1, n));
  std::vector<double> residual(n);
  for (std::size_t i = 0; i < n; ++i) residual[i] = recording.output.values[i] - simulated[i];
  BinnedResidual binned{.value = Eigen::VectorXd(Eigen::Index(bins)), .time_s = {}, .white_sd = 0};
  for (std::size_t k = 0; k < bins; ++k) {
    const std::size_t begin = k * n / bins, end = (k + 1) * n / bins;
    double sum = 0, count = 0;
    for (std::size_t i = begin; i < end; ++i) {
      if (!recording.is_valid(i) || !std::isfinite(residual[i])) continue;
      sum += residual[i];
      count += 1;
    }
    binned.value(Eigen::Index(k)) = count > 0 ? sum / count : std::numeric_limits<double>::quiet_NaN();
    binned.time_s.push_back(0.5 * static_cast<double>(begin + end) * recording.sample_period_s);
  }
  binned.white_sd = noise_of(residual) / std::sqrt(static_cast<double>(n) / static_cast<double>(bins));
  return binned;
}

Eigen::MatrixXd residual_directions(const Eigen::MatrixXd& residuals, const Eigen::MatrixXd& good,
                                    const Eigen::VectorXd& white_sd) {
  const Eigen::RowVectorXd mean = good.rows() > 0 ? mean_of(good) : Eigen::RowVectorXd::Zero(residuals.cols()).eval();
  Eigen::RowVectorXd scatter = white_sd.transpose().array().square();
  for (Eigen::Index i = 0; i < good.rows(); ++i) {
    const Eigen::ArrayXd off = (good.row(i) - mean).transpose().array();
    scatter.array() += off.isFinite().select(off.square(), 0).transpose();
  }
  const Eigen::ArrayXd sd = (scatter.transpose().array() / (1.0 + static_cast<double>(good.rows()))).sqrt().max(1e-12);
  Eigen::MatrixXd directions(residuals.rows(), residuals.cols());
  for (Eigen::Index i = 0; i < residuals.rows(); ++i) {
    const Eigen::ArrayXd off = (residuals.row(i) - mean).transpose().array() / sd;
    directions.row(i) = off.isFinite().select(off, 0).matrix().transpose();
    const double length = directions.row(i).norm();
    if (length > 0) directions.row(i) /= length;
  }
  return directions;
}

}  // namespace valvetriage
