#include "core/identify/blocked_columns.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kBlockRows = 128;
// Of a column's largest entry: less than rounding. Free runs that stick are rough, and a fit through them ends in
// another valley for less than one would think.
constexpr double kNothing = 1e-15;

}  // namespace

BlockedColumns::BlockedColumns(MatrixXd dense) : dense_(std::move(dense)) {
  there_.resize(static_cast<std::size_t>((rows() + kBlockRows - 1) / kBlockRows));
  for (Index j = 0; j < cols(); ++j) {
    const auto column = dense_.col(j).cwiseAbs();
    const double largest = rows() > 0 ? column.maxCoeff() : 0;
    const double nothing = std::isfinite(largest) ? kNothing * largest : -1;  // a run that failed is everywhere
    for (std::size_t b = 0; b < there_.size(); ++b) {
      const Index first = static_cast<Index>(b) * kBlockRows;
      if (!(column.segment(first, std::min(kBlockRows, rows() - first)).maxCoeff() <= nothing)) there_[b].push_back(j);
    }
  }
}

std::vector<BlockedColumns::Part> BlockedColumns::parts(Index first, Index count) const {
  std::vector<Part> parts;
  for (Index at = first; at < first + count;) {
    const Index block = at / kBlockRows;
    const Index end = std::min(first + count, (block + 1) * kBlockRows);
    parts.push_back({static_cast<std::size_t>(block), at, end - at});
    at = end;
  }
  return parts;
}

MatrixXd BlockedColumns::gram(Index first, Index count) const {
  MatrixXd gram = MatrixXd::Zero(cols(), cols());
  MatrixXd gathered, product;
  for (const Part& part : parts(first, count)) {
    const std::vector<Index>& there = there_[part.block];
    const auto some = static_cast<Index>(there.size());
    if (some == 0) continue;
    gathered.resize(part.count, some);
    for (Index k = 0; k < some; ++k) {
      gathered.col(k) = dense_.col(there[static_cast<std::size_t>(k)]).segment(part.first, part.count);
    }
    product = MatrixXd::Zero(some, some);
    product.selfadjointView<Eigen::Lower>().rankUpdate(gathered.transpose());
    for (Index k = 0; k < some; ++k) {
      for (Index l = k; l < some; ++l) {
        gram(there[static_cast<std::size_t>(l)], there[static_cast<std::size_t>(k)]) += product(l, k);
      }
    }
  }
  gram.triangularView<Eigen::StrictlyUpper>() = gram.transpose();
  return gram;
}

MatrixXd BlockedColumns::transposed_times(Index first, const MatrixXd& x) const {
  MatrixXd result = MatrixXd::Zero(cols(), x.cols());
  for (const Part& part : parts(first, x.rows())) {
    const auto there = x.middleRows(part.first - first, part.count);
    for (const Index j : there_[part.block]) {
      result.row(j).noalias() += dense_.col(j).segment(part.first, part.count).transpose() * there;
    }
  }
  return result;
}

VectorXd BlockedColumns::times(const VectorXd& x) const {
  VectorXd result = VectorXd::Zero(rows());
  for (const Part& part : parts(0, rows())) {
    auto segment = result.segment(part.first, part.count);
    for (const Index j : there_[part.block]) segment += x(j) * dense_.col(j).segment(part.first, part.count);
  }
  return result;
}

}  // namespace valvetriage
