#include "core/classify/rivals/anfis.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

constexpr double kLeastWidth = 0.1;  // of a standard deviation: narrower sets are single valves

struct SugenoSystem {
  Eigen::MatrixXd centres;      ///< rules × p
  Eigen::MatrixXd widths;       ///< rules × p
  Eigen::MatrixXd consequents;  ///< rules × (1 + p)
};

/// Normalised firing strengths, from logarithms so that a far valve still has a nearest rule.
Eigen::VectorXd normalised_strengths(const SugenoSystem& system, const Eigen::RowVectorXd& x) {
  const Eigen::MatrixXd z = (system.centres.rowwise() - x).cwiseQuotient(system.widths);
  Eigen::VectorXd log_strength = -0.5 * z.rowwise().squaredNorm();
  log_strength.array() -= log_strength.maxCoeff();
  const Eigen::VectorXd strength = log_strength.array().exp();
  return strength / strength.sum();
}

Eigen::VectorXd rule_outputs(const SugenoSystem& system, const Eigen::RowVectorXd& x) {
  return system.consequents.col(0) + system.consequents.rightCols(x.size()) * x.transpose();
}

SugenoSystem start_at_classes(const Eigen::MatrixXd& x, const std::vector<Verdict>& verdicts) {
  std::vector<Verdict> classes;
  for (const Verdict verdict : kVerdicts) {
    if (std::find(verdicts.begin(), verdicts.end(), verdict) != verdicts.end()) classes.push_back(verdict);
  }
  const auto rules = Eigen::Index(classes.size());
  SugenoSystem system{Eigen::MatrixXd::Zero(rules, x.cols()), Eigen::MatrixXd::Zero(rules, x.cols()),
                      Eigen::MatrixXd::Zero(rules, 1 + x.cols())};
  for (Eigen::Index r = 0; r < rules; ++r) {
    Eigen::MatrixXd members(0, x.cols());
    for (Eigen::Index j = 0; j < x.rows(); ++j) {
      if (verdicts[std::size_t(j)] != classes[std::size_t(r)]) continue;
      members.conservativeResize(members.rows() + 1, Eigen::NoChange);
      members.row(members.rows() - 1) = x.row(j);
    }
    system.centres.row(r) = members.colwise().mean();
    const Eigen::MatrixXd centred = members.rowwise() - system.centres.row(r);
    system.widths.row(r) = (centred.colwise().squaredNorm() / double(members.rows())).cwiseSqrt().cwiseMax(0.5);
  }
  return system;
}

/// Forward pass: consequents by ridged least squares.
void fit_consequents(SugenoSystem& system, const Eigen::MatrixXd& x, const Eigen::VectorXd& target, double ridge) {
  const Eigen::Index width = 1 + x.cols();
  Eigen::MatrixXd design(x.rows(), system.centres.rows() * width);
  for (Eigen::Index j = 0; j < x.rows(); ++j) {
    const Eigen::VectorXd w = normalised_strengths(system, x.row(j));
    for (Eigen::Index r = 0; r < w.size(); ++r) {
      design(j, r * width) = w(r);
      design.row(j).segment(r * width + 1, x.cols()) = w(r) * x.row(j);
    }
  }
  Eigen::MatrixXd normal = design.transpose() * design;
  normal.diagonal().array() += ridge * double(x.rows());
  const Eigen::VectorXd solution = solve_symmetric(normal, design.transpose() * target);
  for (Eigen::Index r = 0; r < system.centres.rows(); ++r) {
    system.consequents.row(r) = solution.segment(r * width, width).transpose();
  }
}

/// Backward pass: one normalised gradient step on centres and widths.
void step_premises(SugenoSystem& system, const Eigen::MatrixXd& x, const Eigen::VectorXd& target, double step) {
  Eigen::MatrixXd to_centres = Eigen::MatrixXd::Zero(system.centres.rows(), x.cols());
  Eigen::MatrixXd to_widths = to_centres;
  for (Eigen::Index j = 0; j < x.rows(); ++j) {
    const Eigen::VectorXd w = normalised_strengths(system, x.row(j));
    const Eigen::VectorXd f = rule_outputs(system, x.row(j));
    const double y = w.dot(f);
    for (Eigen::Index r = 0; r < w.size(); ++r) {
      const double sensitivity = (y - target(j)) * w(r) * (f(r) - y);
      const Eigen::RowVectorXd z = (x.row(j) - system.centres.row(r)).cwiseQuotient(system.widths.row(r));
      to_centres.row(r) += sensitivity * z.cwiseQuotient(system.widths.row(r));
      to_widths.row(r) += sensitivity * z.cwiseAbs2().cwiseQuotient(system.widths.row(r));
    }
  }
  const double length = std::sqrt(to_centres.squaredNorm() + to_widths.squaredNorm());
  if (!(length > 0)) return;
  system.centres -= step / length * to_centres;
  system.widths = (system.widths - step / length * to_widths).cwiseMax(kLeastWidth);
}

Memberships around(double y) {
  Memberships memberships{};
  const double inside = std::clamp(y, 0.0, double(kVerdictCount - 1));
  for (std::size_t c = 0; c < kVerdictCount; ++c) memberships[c] = std::max(0.0, 1 - std::abs(inside - double(c)));
  return memberships;
}

}  // namespace

RivalClassifier train_anfis(const TrainingSet& training, const AnfisOptions& options) {
  const Standardiser standardise(training.features);
  const Eigen::MatrixXd x = standardise.all(training.features);
  Eigen::VectorXd target(x.rows());
  for (Eigen::Index j = 0; j < x.rows(); ++j) target(j) = double(index_of(training.verdicts[std::size_t(j)]));
  SugenoSystem system = start_at_classes(x, training.verdicts);
  for (int epoch = 0; epoch < options.epochs; ++epoch) {
    fit_consequents(system, x, target, options.ridge);
    step_premises(system, x, target, options.step);
  }
  fit_consequents(system, x, target, options.ridge);
  return [=](const Eigen::VectorXd& features) {
    const Eigen::RowVectorXd at = standardise(features).transpose();
    return by_largest(around(normalised_strengths(system, at).dot(rule_outputs(system, at))));
  };
}

}  // namespace valvetriage
