#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <vector>

#include "core/discrepancy/machine_leftover.h"

namespace valvetriage {

/// The values moved on by a part of their number, those at the end to the beginning.
inline Eigen::VectorXd shifted(const Eigen::VectorXd& values, double part) {
  const auto shift = static_cast<Eigen::Index>(part * static_cast<double>(values.size()));
  Eigen::VectorXd moved(values.size());
  moved << values.tail(values.size() - shift), values.head(shift);
  return moved;
}

/// A share of a residual's power against the same share of the residual moved along its records: the move keeps its
/// spectrum and what it is regressed on, and breaks only what joins them. Moves by less than a twentieth of a record do
/// not count: what answers late answers there as well.
///
/// share_of  the share where the residual is moved on by a part in [0, 1) of each record
template <typename ShareOf>
LeftAnswer beyond_chance(const ShareOf& share_of) {
  constexpr std::size_t kMoves = 400;
  constexpr double kNear = 0.05;
  const double share = share_of(0.0);
  if (!std::isfinite(share)) return {};
  std::vector<double> by_chance;
  for (std::size_t k = 1; k < kMoves; ++k) {
    const double part = static_cast<double>(k) / static_cast<double>(kMoves);
    if (part >= kNear && part <= 1 - kNear) by_chance.push_back(share_of(part));
  }
  std::sort(by_chance.begin(), by_chance.end());
  const double usual = by_chance[by_chance.size() / 2];
  const double spread = by_chance.back() - usual;
  return {share - usual, spread > 0 ? (share - usual) / spread : 0};
}

}  // namespace valvetriage
