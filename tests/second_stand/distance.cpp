#include "tests/second_stand/distance.h"

#include <algorithm>
#include <cmath>

namespace valvetriage::second_stand {
namespace {

Eigen::VectorXd outputs(const Order& order, const Unit& unit) {
  const std::vector<double> clean_psi = clean_outputs(order, unit);
  return Eigen::Map<const Eigen::VectorXd>(clean_psi.data(), static_cast<Eigen::Index>(clean_psi.size()));
}

}  // namespace

Distance::Distance(const std::vector<std::string>& tests) {
  Order order;
  order.tests = tests;
  Latents latents(latent_names().size(), 0);
  const Eigen::VectorXd nominal = outputs(order, unit_of(latents));
  spread_.resize(nominal.size(), static_cast<Eigen::Index>(latents.size()));
  for (std::size_t i = 0; i < latents.size(); ++i) {
    latents[i] = 1;
    spread_.col(static_cast<Eigen::Index>(i)) = outputs(order, unit_of(latents)) - nominal;
    latents[i] = 0;
  }
  const double variance = order.noise_psi * order.noise_psi;
  Eigen::MatrixXd inner = spread_.transpose() * spread_;
  inner.diagonal().array() += variance;
  spread_factor_.compute(inner);
}

Distance::Figures Distance::measure(const Order& order) const {
  Order healthy = order;
  healthy.effects.clear();
  const Unit unit = unit_of(draw_latents(order.unit_seed));
  const Eigen::VectorXd signature = outputs(order, unit) - outputs(healthy, unit);
  const Eigen::VectorXd seen = spread_.transpose() * signature;
  const double energy = signature.squaredNorm();
  const double left = std::max(0.0, energy - seen.dot(spread_factor_.solve(seen)));  // Woodbury
  return {std::sqrt(left) / order.noise_psi, std::sqrt(energy) / order.noise_psi};
}

}  // namespace valvetriage::second_stand
