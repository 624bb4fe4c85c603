#include "core/discrepancy/linearised_valve.h"

#include <algorithm>
#include <cmath>

namespace valvetriage {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

LinearisedValve::LinearisedValve(const ValveFitProblem& problem, VectorXd v) : problem_(problem), v_(std::move(v)) {
  normal_ = {MatrixXd::Zero(problem.size(), problem.size()), VectorXd::Zero(problem.size())};
  runs_ = problem.all_runs(v_);
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    rows_.push_back(problem.rows(v_, r));
    error_.push_back(rows_.back().error);
    problem.accumulate(rows_.back(), 0, rows_.back().error.size(), r, normal_);
    samples_ += static_cast<double>(rows_.back().error.size());
  }
  by_samples_ = normal_.a;
  problem.add_penalty(v_, normal_);
  // A recording that says nothing about a knot leaves a zero on the diagonal where there is no prior. Each entry by
  // itself: what a population knows to a millionth would stiffen everything beside it.
  for (double& diagonal : normal_.a.diagonal()) diagonal = diagonal > 0 ? (1 + 1e-12) * diagonal : 1;
  factor_.compute(normal_.a);
  newton_ = factor_.solve(normal_.b);
  hold_at_bounds();
  cost_ = problem.cost(v_);
}

void LinearisedValve::hold_at_bounds() {
  for (Index found = -1;;) {
    found = -1;
    for (Index j = 0; j < problem_.baseline_size() - problem_.knots() && found < 0; ++j) {
      const bool is_held = std::find(held_.begin(), held_.end(), j) != held_.end();
      if (!is_held && problem_.is_at_bound(v_, j) && problem_.leaves_bounds(v_, j, newton_(j))) found = j;
    }
    if (found < 0) return;
    held_.push_back(found);
    normal_.a.row(found).setZero();
    normal_.a.col(found).setZero();
    normal_.a(found, found) = 1;
    normal_.b(found) = 0;
    factor_.compute(normal_.a);
    newton_ = factor_.solve(normal_.b);
  }
}

VectorXd LinearisedValve::errors(double inflation) const {
  const MatrixXd spread = factor_.solve(factor_.solve(by_samples_).transpose());
  return (inflation * spread.diagonal().array().max(0.0)).sqrt();
}

VectorXd LinearisedValve::whitened(std::size_t recording, std::span<const double> simulated) const {
  const auto& samples = rows_[recording].sample;
  const std::vector<double>& own = runs_[recording].output;
  VectorXd column(static_cast<Index>(samples.size()));
  for (std::size_t i = 0; i < samples.size(); ++i) {
    column(static_cast<Index>(i)) = simulated[samples[i]] - own[samples[i]];
  }
  problem_.whiten(recording, samples, column);
  return column;
}

std::vector<LinearisedValve::Signature> LinearisedValve::signatures(std::vector<Stack> columns) const {
  const auto count = static_cast<Index>(columns.size());
  const Index shared = problem_.shared();
  MatrixXd loads = MatrixXd::Zero(problem_.size(), count);
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    std::vector<Index> seen;  // a law of one recording changes nothing in the others
    for (Index k = 0; k < count; ++k) {
      if (!columns[static_cast<std::size_t>(k)][r].isZero(0)) seen.push_back(k);
    }
    if (seen.empty()) continue;
    MatrixXd there(rows_[r].error.size(), static_cast<Index>(seen.size()));
    for (std::size_t i = 0; i < seen.size(); ++i) {
      there.col(static_cast<Index>(i)) = columns[static_cast<std::size_t>(seen[i])][r];
    }
    const MatrixXd local = rows_[r].jacobian.transposed_times(0, there);
    for (std::size_t i = 0; i < seen.size(); ++i) {
      loads.col(seen[i]).head(shared) += local.col(static_cast<Index>(i)).head(shared);
      loads.col(seen[i]).segment(problem_.own_at(r), problem_.own()) +=
          local.col(static_cast<Index>(i)).tail(problem_.own());
    }
  }
  for (const Index j : held_) loads.row(j).setZero();
  const MatrixXd absorbed = factor_.solve(loads);
  std::vector<Signature> signatures;
  for (Index k = 0; k < count; ++k) {
    signatures.push_back({std::move(columns[static_cast<std::size_t>(k)]), loads.col(k), absorbed.col(k)});
  }
  return signatures;
}

LinearisedValve::Signature LinearisedValve::signature(Stack column) const {
  std::vector<Stack> one;
  one.push_back(std::move(column));
  return std::move(signatures(std::move(one)).front());
}

double LinearisedValve::product(const Signature& a, const Signature& b) const {
  double sum = -a.load.dot(b.absorbed);
  for (std::size_t r = 0; r < rows_.size(); ++r) sum += a.column[r].dot(b.column[r]);
  return sum;
}

double LinearisedValve::told_by_samples(const Signature& a) const {
  double squares = 0;
  for (const VectorXd& left : moved(a.column, a.absorbed)) squares += left.squaredNorm();
  return std::min(squares, product(a, a));
}

double LinearisedValve::against_error(const Signature& a) const {
  double sum = -a.load.dot(newton_);
  for (std::size_t r = 0; r < rows_.size(); ++r) sum += a.column[r].dot(error_[r]);
  return sum;
}

double LinearisedValve::cost_without(const Signature& taken) const {
  return product(taken, taken) - 2 * against_error(taken);
}

Stack LinearisedValve::moved(Stack left, const VectorXd& shift) const {
  for (std::size_t r = 0; r < rows_.size(); ++r) {
    VectorXd local(rows_[r].jacobian.cols());
    local << shift.head(problem_.shared()), shift.segment(problem_.own_at(r), problem_.own());
    left[r] -= rows_[r].jacobian.times(local);
  }
  return left;
}

Stack LinearisedValve::residual_without(const Signature& taken) const {
  Stack left = error_;
  for (std::size_t r = 0; r < rows_.size(); ++r) left[r] -= taken.column[r];
  return moved(std::move(left), shift_without(taken));
}

Stack LinearisedValve::residual_alone() const {
  return moved(error_, newton_);
}

VectorXd LinearisedValve::shift_without(const Signature& taken) const {
  return newton_ - taken.absorbed;
}

}  // namespace valvetriage
