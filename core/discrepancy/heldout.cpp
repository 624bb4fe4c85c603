#include "core/discrepancy/heldout.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <set>

#include "core/discrepancy/black_box.h"
#include "core/discrepancy/reduction_interval.h"
#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kBlocksPerRecording = 4;
constexpr std::size_t kFewestRecordings = 3;
// Of noise alone a law takes up half of this in noise variances with each of its parameters, and foretells held-out
// samples as much worse: less is no reason to use it. Akaike, IEEE Trans. Automatic Control 19 (1974) 716.
constexpr double kPriceOfParameter = 2;

// Of a search without one recording, which begins where that with it ended.
constexpr int kRoughSteps = 4;

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

/// Measured − simulated on a fold.
VectorXd errors_on(const Recording& recording, const std::vector<double>& simulated, const Fold& fold,
                   const ValveFitProblem::Rows& rows) {
  VectorXd errors(fold.count);
  for (Index i = 0; i < fold.count; ++i) {
    const std::size_t at = rows.sample[static_cast<std::size_t>(fold.first + i)];
    errors(i) = recording.output.values[at] - simulated[at];
  }
  return errors;
}

/// The same of a vector.
VectorXd errors_on(const ValveFitProblem& problem, const VectorXd& v, const Fold& fold,
                   const ValveFitProblem::Rows& rows) {
  return errors_on(problem.recording(fold.recording), problem.simulate(v, fold.recording), fold, rows);
}

/// Whether the phase of a law is that of the reading around each sample, of held-out samples too.
bool follows_the_reading(const Explanation& explanation) {
  return std::any_of(explanation.laws.begin(), explanation.laws.end(),
                     [](const LawFit& law) { return law.law.law->cause == "self_oscillation"; });
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
    is_rough_ = problem.width_at(explanation.v) > 1;
    turns_ = follows_the_reading(explanation);
  }

  const std::vector<ValveFitProblem::Rows>& rows() const { return rows_; }

  struct Without {
    VectorXd v;
    double cost = 0;  ///< of the samples that were kept
  };
  Without without(std::span<const Fold> folds) const {
    const ValveFitProblem& problem = *explanation_.problem;
    if (is_rough_ && folds.size() == 1 && is_whole(folds.front())) return searched_without(folds.front().recording);
    ValveFitProblem::Normal left_out = empty();
    for (const Fold& fold : folds) {
      problem.accumulate(rows_[fold.recording], fold.first, fold.count, fold.recording, left_out);
    }
    MatrixXd a = normal_.a - left_out.a;
    const VectorXd b = normal_.b - left_out.b;
    // A recording left out whole keeps the initial state that its own first samples gave.
    for (Index j = 0; j < a.rows(); ++j) a(j, j) += normal_.a(j, j) > 0 ? 1e-9 * normal_.a(j, j) : 1;
    const VectorXd step = bounded_step(a, b);
    double squares = 0;
    VectorXd moved = step;
    for (const Fold& fold : folds) {
      if (is_whole(fold)) moved.segment(problem.own_at(fold.recording), problem.own()).setZero();
      squares += rows_[fold.recording].error.segment(fold.first, fold.count).squaredNorm();
    }
    const double kept = explanation_.cost - squares;
    if (!explanation_.laws.empty()) return as_far_as_it_lowers(moved, folds, kept);
    const double change = step.dot(a * step) - 2 * b.dot(step);
    return {problem.clamped(explanation_.v + moved), kept + change};
  }

 private:
  bool is_whole(const Fold& fold) const { return fold.count == rows_[fold.recording].error.size(); }

  /// A law is linear over a short way only, and so is a valve where the fit leaves much of what is measured: a whole
  /// step may lead past the minimum, along a direction in which a law and the map stand for each other far past it, and
  /// for a phase that turns with the level nearly always.
  ///
  /// kept  cost of the samples that were kept, before the step
  Without as_far_as_it_lowers(const VectorXd& step, std::span<const Fold> folds, double kept) const {
    const ValveFitProblem& problem = *explanation_.problem;
    Without best;
    for (const double share : {1.0, 0.5, 0.25, 0.125}) {
      Without tried{problem.clamped(explanation_.v + share * step)};
      const std::vector<ValveFitProblem::Run> runs = problem.all_runs(tried.v);
      tried.cost = problem.cost(tried.v, runs);
      for (const Fold& fold : folds) {
        const std::size_t r = fold.recording;
        const Fold whole{r, 0, rows_[r].error.size()};
        VectorXd errors = errors_on(problem.recording(r), runs[r].output, whole, rows_[r]);
        problem.whiten(r, rows_[r].sample, errors);
        tried.cost -= errors.segment(fold.first, fold.count).squaredNorm();
      }
      if (!turns_ && tried.cost <= kept) return tried;
      if (share < 1 && !(tried.cost < best.cost)) break;
      best = std::move(tried);
    }
    return best;
  }

  /// Where the cost is rough one linear step is no refit: down again from where the whole fit ended.
  Without searched_without(std::size_t recording) const {
    ValveFitProblem problem(*explanation_.problem, *explanation_.options);
    problem.leave_out(recording);
    Descent found = descend(problem, explanation_.v, kRoughSteps);
    found.v.segment(problem.own_at(recording), problem.own()) =
        explanation_.v.segment(problem.own_at(recording), problem.own());
    return {std::move(found.v), found.cost};
  }

  /// The step to the minimum within the bounds: an entry that would pass its bound stops there, the others make up for
  /// it.
  VectorXd bounded_step(const MatrixXd& a, const VectorXd& b) const {
    constexpr int kMostRounds = 8;
    const VectorXd& v = explanation_.v;
    VectorXd step = solve_symmetric(a, b);
    std::vector<Index> stopped;
    for (int round = 0; round < kMostRounds; ++round) {
      const VectorXd allowed = explanation_.problem->clamped(v + step) - v;
      const std::size_t before = stopped.size();
      MatrixXd free = a;
      VectorXd right = b;
      for (Index j = 0; j < step.size(); ++j) {
        const bool is_stopped = std::find(stopped.begin(), stopped.end(), j) != stopped.end();
        if (!is_stopped && std::abs(allowed(j) - step(j)) <= 1e-12 * std::abs(step(j))) continue;
        if (!is_stopped) stopped.push_back(j);
        right -= allowed(j) * a.col(j);
      }
      if (stopped.size() == before) break;
      for (const Index j : stopped) {
        free.row(j).setZero();
        free.col(j).setZero();
        free(j, j) = 1;
        right(j) = allowed(j);
      }
      step = solve_symmetric(free, right);
    }
    return step;
  }

  ValveFitProblem::Normal empty() const {
    const Index size = explanation_.problem->size();
    return {MatrixXd::Zero(size, size), VectorXd::Zero(size)};
  }

  const Explanation& explanation_;
  std::vector<ValveFitProblem::Rows> rows_;
  ValveFitProblem::Normal normal_;
  bool is_rough_ = false, turns_ = false;
};

double price_of(const Explanation& explanation) {
  std::ptrdiff_t varied = 0;
  for (const LawFit& fitted : explanation.laws) {
    const std::vector<double>& step = fitted.law.step;
    varied += std::count_if(step.begin(), step.end(), [](double s) { return s > 0; });
  }
  return kPriceOfParameter * static_cast<double>(varied);
}

/// Squared errors of baseline and explanation on folds that took no part in either's fit.
struct Compared {
  VectorXd baseline;  ///< errors of the baseline, fold after fold
  double extended = 0;
  double surprise = 0;  ///< as MeasuredGain's
};

Compared compare(const Explanation& baseline, const Explanation& extended, const Refit& before, const Refit& after,
                 std::span<const Fold> folds) {
  const Refit::Without plain = before.without(folds), rich = after.without(folds);
  const bool pays = !extended.laws.empty() && rich.cost + price_of(extended) < plain.cost;
  Compared compared;
  compared.surprise = (extended.cost - rich.cost) - (baseline.cost - plain.cost);
  for (const Fold& fold : folds) {
    const ValveFitProblem::Rows& rows = before.rows()[fold.recording];
    const VectorXd errors = errors_on(*baseline.problem, plain.v, fold, rows);
    compared.baseline.conservativeResize(compared.baseline.size() + errors.size());
    compared.baseline.tail(errors.size()) = errors;
    compared.extended += pays ? errors_on(*extended.problem, rich.v, fold, rows).squaredNorm() : errors.squaredNorm();
  }
  return compared;
}

constexpr std::array<double, 2> kBoxLags_s{0.03, 0.3};
constexpr std::array<double, 2> kBoxPlays{0.01, 0.04};  // half widths, of the input's range
constexpr std::array<std::size_t, 2> kBoxSteps{1, 4};   // samples
constexpr std::array<double, 3> kBoxRidges{1e-6, 1e-3, 1e-1};
constexpr Index kBoxRows = 4000;

/// What remembers the input in one recording: the simulated output, how far it is from two lags of itself, two plays of
/// the input, how far the input has come within a few samples, the time. One row per row of the linearisation, each
/// column about one in size.
MatrixXd box_states(const Explanation& baseline, std::size_t r, const ValveFitProblem::Rows& rows) {
  const ValveFitProblem& problem = *baseline.problem;
  const Recording& recording = problem.recording(r);
  const std::vector<double> y = problem.simulate(baseline.v, r);
  const std::vector<double>& u = recording.input.values;
  const double output = baseline.options->reference_psi;
  const double low = baseline.options->knots.front(), range = baseline.options->knots.back() - low;
  std::array<double, kBoxLags_s.size()> lagged;
  lagged.fill(y.front());
  std::array<double, kBoxPlays.size()> played;
  played.fill(u.front());
  MatrixXd states(rows.error.size(), 2 + static_cast<Index>(kBoxLags_s.size() + kBoxPlays.size() + kBoxSteps.size()));
  std::size_t row = 0;
  for (std::size_t i = 0; i < y.size() && row < rows.sample.size(); ++i) {
    for (std::size_t k = 0; k < lagged.size(); ++k) {
      lagged[k] += (y[i] - lagged[k]) * -std::expm1(-recording.sample_period_s / kBoxLags_s[k]);
    }
    for (std::size_t k = 0; k < played.size(); ++k) {
      played[k] = std::clamp(played[k], u[i] - kBoxPlays[k] * range, u[i] + kBoxPlays[k] * range);
    }
    if (rows.sample[row] != i) continue;
    const auto at = static_cast<Index>(row++);
    Index column = 0;
    states(at, column++) = y[i] / output - 1;
    for (const double slow : lagged) states(at, column++) = (y[i] - slow) / output;
    for (std::size_t k = 0; k < played.size(); ++k) {
      states(at, column++) = (u[i] - played[k]) / (kBoxPlays[k] * range);
    }
    for (const std::size_t back : kBoxSteps) states(at, column++) = (u[i] - u[i - std::min(back, i)]) / range;
    states(at, column) = static_cast<double>(i) / static_cast<double>(y.size()) - 0.5;
  }
  return states;
}

/// Squared errors of the black box on each fold in turn, the best of a few strengths of its ridge; none of it at all is
/// one of them, for what extrapolates badly is no bound.
double black_box_squares(const Explanation& baseline, const Refit& before, const std::vector<Fold>& folds,
                         const std::vector<VectorXd>& errors) {
  std::vector<MatrixXd> terms;
  std::vector<VectorXd> own_errors;  // where the box learns, of the baseline as it is
  Index total = 0, states = 0;
  for (std::size_t r = 0; r < before.rows().size(); ++r) {
    const MatrixXd remembered = box_states(baseline, r, before.rows()[r]);
    states = remembered.cols();
    terms.push_back(polynomials(remembered));
    total += terms.back().rows();
    own_errors.push_back(errors_on(*baseline.problem, baseline.v, {r, 0, terms[r].rows()}, before.rows()[r]));
  }
  const Index step = std::max<Index>(1, total / kBoxRows);
  const Index width = terms.front().cols();
  struct Normal {
    MatrixXd square;
    VectorXd right;
  };
  const auto normal_of = [&](const Fold& part) {
    Normal normal{MatrixXd::Zero(width, width), VectorXd::Zero(width)};
    const MatrixXd& own = terms[part.recording];
    const VectorXd& error = own_errors[part.recording];
    const Index count = (part.count + step - 1) / step;
    MatrixXd thinned(count, width);
    VectorXd residual(count);
    for (Index i = 0; i < count; ++i) {
      thinned.row(i) = own.row(part.first + i * step);
      residual(i) = error(part.first + i * step);
    }
    normal.square.noalias() = thinned.transpose() * thinned;
    normal.right.noalias() = thinned.transpose() * residual;
    return normal;
  };
  Normal all{MatrixXd::Zero(width, width), VectorXd::Zero(width)};
  for (std::size_t r = 0; r < terms.size(); ++r) {
    const Normal own = normal_of({r, 0, terms[r].rows()});
    all.square += own.square;
    all.right += own.right;
  }
  // Straight lines alone, and all of it: what bends may not hold where no test has been.
  const std::array<Index, 2> sizes{1 + states, width};
  std::array<double, 2 * kBoxRidges.size() + 1> squares{};
  for (std::size_t f = 0; f < folds.size(); ++f) {
    const Normal own = normal_of(folds[f]);
    const MatrixXd square = all.square - own.square;
    const VectorXd right = all.right - own.right;
    squares.back() += errors[f].squaredNorm();
    std::size_t box = 0;
    for (const Index size : sizes) {
      const auto held_out = terms[folds[f].recording].block(folds[f].first, 0, folds[f].count, size);
      for (const double strength : kBoxRidges) {
        const VectorXd weights = ridge(square.topLeftCorner(size, size), right.head(size), strength);
        squares[box++] += (errors[f] - held_out * weights).squaredNorm();
      }
    }
  }
  return *std::min_element(squares.begin(), squares.end());
}

/// Gain on each kind of test, fitted on the others.
std::vector<Transfer> transfers(const Explanation& baseline, const Explanation& extended, const Refit& before,
                                const Refit& after, const std::vector<Fold>& whole) {
  std::vector<Transfer> transfers;
  if (extended.laws.empty()) return transfers;
  std::set<TestKind> kinds;
  for (std::size_t r = 0; r < whole.size(); ++r) kinds.insert(baseline.problem->recording(r).test);
  if (kinds.size() < 2) return transfers;
  for (const TestKind kind : kinds) {
    std::vector<Fold> left_out;
    std::set<std::string> others;
    for (const Fold& fold : whole) {
      const TestKind own = baseline.problem->recording(fold.recording).test;
      if (own == kind) left_out.push_back(fold);
      if (own != kind) others.insert(std::string(to_string(own)));
    }
    const Compared compared = compare(baseline, extended, before, after, left_out);
    const auto samples = static_cast<double>(compared.baseline.size());
    Transfer transfer{.to = std::string(to_string(kind))};
    for (const std::string& other : others) transfer.from += (transfer.from.empty() ? "" : ", ") + other;
    transfer.rmse_baseline = std::sqrt(compared.baseline.squaredNorm() / samples);
    transfer.rmse_extended = std::sqrt(compared.extended / samples);
    transfers.push_back(std::move(transfer));
  }
  return transfers;
}

struct FoldScore {
  HeldOutSquares squares;
  double samples = 0, surprise = 0;
};

/// Every fold with what it was compared by.
struct Measured {
  bool whole = false;  ///< folds are recordings
  std::vector<Fold> folds;
  std::vector<FoldScore> scores;
  std::vector<VectorXd> errors;  ///< of the baseline

  std::vector<HeldOutSquares> squares() const {
    std::vector<HeldOutSquares> all;
    for (const FoldScore& score : scores) all.push_back(score.squares);
    return all;
  }
};

/// Whether recordings are left out whole: what has an instant or a phase of its own in every recording cannot be
/// foretold for one that was left out.
bool leaves_recordings_out(const Explanation& extended) {
  const bool in_one = std::any_of(extended.laws.begin(), extended.laws.end(), [](const LawFit& law) {
    return law.law.recording || law.law.own() > 0 || law.law.law->family == "disturbance";
  });
  return !in_one && extended.problem->recordings() >= kFewestRecordings;
}

Measured measure(const Explanation& baseline, const Explanation& extended, const Refit& before, const Refit& after,
                 bool whole) {
  Measured measured{.whole = whole};
  measured.folds = folds_of(before.rows(), measured.whole);
  for (const Fold& fold : measured.folds) {
    Compared compared = compare(baseline, extended, before, after, std::span(&fold, 1));
    measured.scores.push_back(
        {{compared.baseline.squaredNorm(), compared.extended}, static_cast<double>(fold.count), compared.surprise});
    measured.errors.push_back(std::move(compared.baseline));
  }
  return measured;
}

}  // namespace

MeasuredGain measure_gain(const Explanation& baseline, const Explanation& extended) {
  const Refit before(baseline), after(extended);
  const Measured measured = measure(baseline, extended, before, after, leaves_recordings_out(extended));
  MeasuredGain both{{.heldout = measured.whole ? "each recording in turn" : "each later quarter of a recording in turn",
                     .rmse_black_box = std::numeric_limits<double>::quiet_NaN()}};
  DiscrepancyGain& gain = both.gain;
  if (follows_the_reading(extended)) gain.heldout += ", the phase of the hunting followed beside each sample";
  double squares_baseline = 0, squares_extended = 0, floor = 0, samples = 0;
  for (std::size_t f = 0; f < measured.folds.size(); ++f) {
    const FoldScore& score = measured.scores[f];
    squares_baseline += score.squares.baseline;
    squares_extended += score.squares.extended;
    floor += score.samples / baseline.problem->inverse_variance(measured.folds[f].recording);
    samples += score.samples;
    both.surprise += score.surprise;
  }
  if (samples == 0) return both;
  gain.rmse_baseline = std::sqrt(squares_baseline / samples);
  gain.rmse_extended = std::sqrt(squares_extended / samples);
  gain.rmse_black_box = std::sqrt(black_box_squares(baseline, before, measured.folds, measured.errors) / samples);
  gain.noise_floor = std::sqrt(floor / samples);
  gain.reduction = squares_baseline > 0 ? 1 - std::sqrt(squares_extended / squares_baseline) : 0;
  gain.reduction_ci95 = reduction_interval(measured.squares());
  if (measured.whole) gain.transfer = transfers(baseline, extended, before, after, measured.folds);
  return both;
}

double held_out_rmse(const Explanation& baseline, const Explanation& fewer, const Explanation& all) {
  const Refit before(baseline), after(fewer);
  double squares = 0, samples = 0;
  for (const FoldScore& score : measure(baseline, fewer, before, after, leaves_recordings_out(all)).scores) {
    squares += score.squares.extended;
    samples += score.samples;
  }
  return samples > 0 ? std::sqrt(squares / samples) : std::numeric_limits<double>::quiet_NaN();
}

bool is_borne_out(const Explanation& baseline, const Explanation& extended) {
  const Refit before(baseline), after(extended);
  const Measured measured = measure(baseline, extended, before, after, leaves_recordings_out(extended));
  return !measured.scores.empty() && reduction_interval(measured.squares()).front() > 0;
}

}  // namespace valvetriage
