#pragma once

#include <Eigen/Core>
#include <vector>

namespace valvetriage {

/// A tall matrix most of whose columns are nothing most of the way, as the sensitivities to a map's knots are: a knot
/// matters while the valve is near it and a little longer. Products skip, in every block of rows, the columns that are
/// nothing there: below 1e-15 of their largest entry, less than rounding.
class BlockedColumns {
 public:
  BlockedColumns() = default;
  explicit BlockedColumns(Eigen::MatrixXd dense);

  Eigen::Index rows() const { return dense_.rows(); }
  Eigen::Index cols() const { return dense_.cols(); }

  /// Mᵀ M of rows [first, first + count), both halves filled. Cost O(count · columns that are there²)
  Eigen::MatrixXd gram(Eigen::Index first, Eigen::Index count) const;
  /// Mᵀ x of rows [first, first + x.rows()), for each column of x.
  Eigen::MatrixXd transposed_times(Eigen::Index first, const Eigen::MatrixXd& x) const;
  /// M x
  Eigen::VectorXd times(const Eigen::VectorXd& x) const;

 private:
  /// What a part of the rows has in common with block b: rows [first, first + count) of the matrix.
  struct Part {
    std::size_t block = 0;
    Eigen::Index first = 0, count = 0;
  };
  std::vector<Part> parts(Eigen::Index first, Eigen::Index count) const;

  Eigen::MatrixXd dense_;
  std::vector<std::vector<Eigen::Index>> there_;  ///< columns that are something, by block
};

}  // namespace valvetriage
