#include "core/discrepancy/heldout.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kBlocksPerRecording = 4;
constexpr std::size_t kFewestRecordings = 3;
constexpr int kBootstraps = 400;

/// Rows [first, last) of one recording.
struct Fold {
  std::size_t recording = 0;
  Index first = 0, count = 0;
};

std::vector<Fold> folds_of(const std::vector<ValveFitProblem::Rows>& rows, bool whole_recordings) {
  std::vector<Fold> folds;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    const Index n = rows[r].error.size();
    if (whole_recordings) {
      folds.push_back({r, 0, n});
      continue;
    }
    const Index block = n / static_cast<Index>(kBlocksPerRecording);
    for (Index b = 1; b < static_cast<Index>(kBlocksPerRecording) && block > 0; ++b) {
      folds.push_back({r, b * block, b + 1 == static_cast<Index>(kBlocksPerRecording) ? n - b * block : block});
    }
  }
  return folds;
}

/// An explanation with its rows, ready to be fitted without any of them.
class Refit {
 public:
  explicit Refit(const Explanation& explanation) : explanation_(explanation) {
    const ValveFitProblem& problem = *explanation.problem;
    normal_ = empty();
    for (std::size_t r = 0; r < problem.recordings(); ++r) {
      rows_.push_back(problem.rows(explanation.v, r));
      problem.accumulate(rows_.back(), 0, rows_.back().error.size(), r, normal_);
    }
    problem.add_penalty(explanation.v, normal_);
  }

  const std::vector<ValveFitProblem::Rows>& rows() const { return rows_; }

  struct Without {
    VectorXd v;
    double cost = 0;  ///< of the samples that were kept
  };
  Without without(const Fold& fold) const {
    const ValveFitProblem& problem = *explanation_.problem;
    ValveFitProblem::Normal left_out = empty();
    problem.accumulate(rows_[fold.recording], fold.first, fold.count, fold.recording, left_out);
    MatrixXd a = normal_.a - left_out.a;
    const VectorXd b = normal_.b - left_out.b;
    // A recording left out whole keeps the initial state that its own first samples gave.
    a.diagonal().array() += 1e-9 * normal_.a.diagonal().array() + 1e-12 * normal_.a.diagonal().maxCoeff();
    VectorXd step = a.ldlt().solve(b);
    const bool whole = fold.count == rows_[fold.recording].error.size();
    if (whole) step.segment(problem.own_at(fold.recording), problem.own()).setZero();
    const auto errors = rows_[fold.recording].error.segment(fold.first, fold.count);
    const double kept = explanation_.cost - static_cast<double>(problem.stride()) * errors.squaredNorm() - b.dot(step);
    return {problem.clamped(explanation_.v + step), kept};
  }

 private:
  ValveFitProblem::Normal empty() const {
    const Index size = explanation_.problem->size();
    return {MatrixXd::Zero(size, size), VectorXd::Zero(size)};
  }

  const Explanation& explanation_;
  std::vector<ValveFitProblem::Rows> rows_;
  ValveFitProblem::Normal normal_;
};

/// Sum of squared errors of a vector on a fold.
double squares_on(const ValveFitProblem& problem, const VectorXd& v, const Fold& fold,
                  const ValveFitProblem::Rows& rows) {
  const std::vector<double> simulated = problem.simulate(v, fold.recording);
  const Recording& recording = problem.recording(fold.recording);
  double squares = 0;
  for (Index i = fold.first; i < fold.first + fold.count; ++i) {
    const std::size_t at = rows.sample[static_cast<std::size_t>(i)];
    const double e = recording.output.values[at] - simulated[at];
    squares += e * e;
  }
  return squares;
}

struct FoldScore {
  double baseline = 0, extended = 0, samples = 0;
};

double reduction_of(const std::vector<FoldScore>& scores, const std::vector<std::size_t>& chosen) {
  double baseline = 0, extended = 0;
  for (const std::size_t i : chosen) {
    baseline += scores[i].baseline;
    extended += scores[i].extended;
  }
  return baseline > 0 ? 1 - std::sqrt(extended / baseline) : 0;
}

std::array<double, 2> bootstrap_interval(const std::vector<FoldScore>& scores) {
  std::mt19937_64 random(scores.size());
  std::vector<double> reductions;
  std::vector<std::size_t> chosen(scores.size());
  for (int i = 0; i < kBootstraps; ++i) {
    for (std::size_t& c : chosen) c = random() % scores.size();
    reductions.push_back(reduction_of(scores, chosen));
  }
  std::sort(reductions.begin(), reductions.end());
  return {reductions[kBootstraps / 40], reductions[kBootstraps - 1 - kBootstraps / 40]};
}

}  // namespace

DiscrepancyGain measure_gain(const Explanation& baseline, const Explanation& extended) {
  const bool in_one = std::any_of(extended.laws.begin(), extended.laws.end(),
                                  [](const LawFit& law) { return law.law.recording || law.law.own() > 0; });
  const Refit before(baseline), after(extended);
  const bool whole = !in_one && before.rows().size() >= kFewestRecordings;
  std::vector<FoldScore> scores;
  double floor = 0, samples = 0;
  for (const Fold& fold : folds_of(before.rows(), whole)) {
    const Refit::Without plain = before.without(fold), rich = after.without(fold);
    const ValveFitProblem::Rows& rows = before.rows()[fold.recording];
    FoldScore score{.samples = static_cast<double>(fold.count)};
    score.baseline = squares_on(*baseline.problem, plain.v, fold, rows);
    const bool pays = !extended.laws.empty() && rich.cost < plain.cost;
    score.extended = pays ? squares_on(*extended.problem, rich.v, fold, rows) : score.baseline;
    floor += score.samples / baseline.problem->inverse_variance(fold.recording);
    samples += score.samples;
    scores.push_back(score);
  }
  DiscrepancyGain gain{.heldout = whole ? "each recording in turn" : "each later quarter of a recording in turn",
                       .rmse_black_box = std::numeric_limits<double>::quiet_NaN()};
  if (scores.empty() || samples == 0) return gain;
  std::vector<std::size_t> all(scores.size());
  double squares_baseline = 0, squares_extended = 0;
  for (std::size_t i = 0; i < scores.size(); ++i) {
    all[i] = i;
    squares_baseline += scores[i].baseline;
    squares_extended += scores[i].extended;
  }
  gain.rmse_baseline = std::sqrt(squares_baseline / samples);
  gain.rmse_extended = std::sqrt(squares_extended / samples);
  gain.noise_floor = std::sqrt(floor / samples);
  gain.reduction = reduction_of(scores, all);
  gain.reduction_ci95 = bootstrap_interval(scores);
  return gain;
}

}  // namespace valvetriage
