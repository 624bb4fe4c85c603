#include "core/classify/rivals/rival.h"

#include <cmath>

namespace valvetriage {

Standardiser::Standardiser(const Eigen::MatrixXd& features) : mean_(features.colwise().mean()) {
  const Eigen::MatrixXd centred = features.rowwise() - mean_;
  const double n = std::max<double>(1, double(features.rows() - 1));
  inverse_sd_ =
      (centred.colwise().squaredNorm() / n).cwiseSqrt().unaryExpr([](double sd) { return sd > 0 ? 1 / sd : 0.0; });
}

Eigen::VectorXd Standardiser::operator()(const Eigen::VectorXd& x) const {
  return (x.transpose() - mean_).cwiseProduct(inverse_sd_).transpose();
}

Eigen::MatrixXd Standardiser::all(const Eigen::MatrixXd& features) const {
  return (features.rowwise() - mean_).array().rowwise() * inverse_sd_.array();
}

RivalPrediction by_largest(const Memberships& memberships) {
  return {largest_membership(memberships), memberships};
}

}  // namespace valvetriage
