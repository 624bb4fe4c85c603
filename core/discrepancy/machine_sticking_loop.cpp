#include "core/discrepancy/machine_sticking_loop.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <vector>

#include "core/discrepancy/machine_search.h"
#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kFewestSamples = 250, kMostSamples = 5000;
constexpr std::array<Index, 5> kOutputLags{4, 6, 9, 13, 20};
constexpr Index kRowsPerLag = 15;
constexpr Index kInputLags = 10;
constexpr double kRankTolerance = 1e-9;  // of the largest eigenvalue: the controller's law makes regressors dependent
constexpr double kBandRatio = 1.015;     // a small error in the band moves every slip
constexpr double kLeastBand = 0.06, kMostBand = 0.95;   // of the input's range
constexpr int kJumps = 24;                              // of equal steps from none to the band
constexpr std::array kFinerSteps{0.01, 0.005, 0.0025};  // of the band
constexpr std::size_t kRefined = 30;
constexpr int kHarmonics = 8;
constexpr int kBlocks = 10;
// Set on 332 simulated healthy loops under load steps, pulses, waves, walks, poor tuning, stops and rounded readings.
// Those reach 283 in the gain and 35 over the other drivers, but not with the process's answer in its sense and nothing
// left to the input; of those that answer and leave nothing, and of 82 further ones, none passed 20 and 4.
constexpr double kLeastGain = 30;        // log likelihood, of about 10,000 laws
constexpr double kOverOtherDrivers = 6;  // log likelihood
constexpr double kMostOfInput = 10;      // log likelihood that kInputLags freedoms may add; 5 are expected
constexpr double kMostShareOfInput = 0.08;
constexpr double kOverWave = 12;  // log likelihood beyond the one per two freedoms that is expected
constexpr int kLeastWon = 8;
constexpr double kLeastRest = 0.25;
constexpr int kLeastMoves = 3;      // in either sense
constexpr double kWithin95 = 1.92;  // half of χ²'s 0.95 quantile with one freedom

/// How far the input must go back until the valve moves on, and how far it then jumps [scaled units].
struct Stick {
  double band = 0, jump = 0;
  bool slides = false;  ///< moves on as the input does until that turns; else by jumps alone

  double breakaway() const { return 0.5 * (band + jump); }
  double kinetic() const { return 0.5 * (band - jump); }
};

VectorXd scaled(const std::vector<double>& values, std::size_t samples, double& scale) {
  VectorXd x = Eigen::Map<const VectorXd>(values.data(), static_cast<Index>(samples));
  x.array() -= x.mean();
  scale = std::sqrt(x.squaredNorm() / static_cast<double>(samples));
  return x / std::max(scale, 1e-300);
}

/// What a valve passes on: it sets off where the force on it exceeds its breakaway, and comes to rest at its kinetic
/// force from the input. One that slides (Karnopp 1985; Kano et al. 2004; Choudhury et al. 2005) then moves on as the
/// input does until that turns; one that jumps rests at once (He et al. 2007).
VectorXd passed_on(const VectorXd& input, const Stick& stick) {
  const double breakaway = stick.breakaway(), kinetic = stick.kinetic();
  VectorXd held(input.size());
  double position = input[0], moving = 0;
  for (Index t = 0; t < input.size(); ++t) {
    const double strain = input[t] - position;
    if (moving != 0 && moving * strain > kinetic) {
      position = input[t] - moving * kinetic;
    } else if (std::abs(strain) > breakaway) {
      const double sense = std::copysign(1, strain);
      position = input[t] - sense * kinetic;
      moving = stick.slides ? sense : 0;
    } else {
      moving = 0;
    }
    held[t] = position;
  }
  return held;
}

VectorXd behind_lag(const VectorXd& x, double lag_samples) {
  const double keep = std::exp(-1 / lag_samples);
  VectorXd y(x.size());
  double state = x[0];
  for (Index t = 0; t < x.size(); ++t) y[t] = state = keep * state + (1 - keep) * x[t];
  return y;
}

double range_of(const VectorXd& x) {
  std::vector<double> sorted(x.data(), x.data() + x.size());
  std::sort(sorted.begin(), sorted.end());
  return sorted[sorted.size() * 99 / 100] - sorted[sorted.size() / 100];
}

/// Orthonormal columns that span a matrix, without what depends on the rest.
MatrixXd basis_of(MatrixXd columns) {
  for (Index c = 0; c < columns.cols(); ++c) columns.col(c) /= std::max(columns.col(c).norm(), 1e-300);
  const SymmetricEigen eigen = symmetric_eigen(columns.transpose() * columns);
  const VectorXd& values = eigen.values;
  const Index dropped = (values.array() <= kRankTolerance * values.maxCoeff()).count();
  const Index kept = values.size() - dropped;
  return columns * (eigen.vectors.rightCols(kept) * values.tail(kept).cwiseSqrt().cwiseInverse().asDiagonal());
}

VectorXd left_of(const VectorXd& target, const MatrixXd& basis) {
  return target - basis * (basis.transpose() * target);
}

/// The regression of the output one step ahead.
class OneStep {
 public:
  OneStep(const Recording& recording, std::size_t samples)
      : input_(scaled(recording.input.values, samples, input_scale)),
        output_(scaled(recording.output.values, samples, output_scale)) {
    for (const Index lags : kOutputLags) {
      if (lags * kRowsPerLag <= static_cast<Index>(samples)) most_ = std::max(lags, most_);
    }
    most_ = std::max(most_, kInputLags);
    // The longest stretch without a hole.
    std::size_t run = 0, longest = 0, end = 0;
    for (std::size_t t = 0; t < samples; ++t) {
      run = recording.is_valid(t) ? run + 1 : 0;
      if (run > longest) {
        longest = run;
        end = t + 1;
      }
    }
    for (std::size_t t = end - longest + static_cast<std::size_t>(most_); t < end; ++t) {
      rows_.push_back(static_cast<Index>(t));
    }
    if (rows_.size() < kFewestSamples / 2) return;
    target_ = output_(rows_);
    choose_lags();
  }

  bool enough() const { return target_.size() > 0; }
  const VectorXd& input() const { return input_; }
  const VectorXd& output() const { return output_; }
  Index output_lags() const { return lags_; }

  MatrixXd lagged(const VectorXd& x, Index lags) const {
    MatrixXd columns(static_cast<Index>(rows_.size()), lags);
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      for (Index k = 0; k < lags; ++k) columns(static_cast<Index>(i), k) = x[rows_[i] - 1 - k];
    }
    return columns;
  }

  /// What is left of the output given its own past, that of a signal, and further columns.
  VectorXd left(const VectorXd& signal, Index lags, const MatrixXd& more) const {
    MatrixXd columns(more.rows(), lags + more.cols());
    columns << lagged(signal, lags), more;
    columns -= past_ * (past_.transpose() * columns);
    return left_of(left_by_past_, basis_of(std::move(columns)));
  }
  VectorXd left(const VectorXd& signal, Index lags) const {
    return left(signal, lags, MatrixXd(static_cast<Index>(rows_.size()), 0));
  }

  /// Squares that are left given the output's past and kInputLags of a signal: left() from sums of products, which
  /// follow from one another as the lags move on together.
  double squares_left(const VectorXd& x) const {
    const Index first = rows_.front(), n = static_cast<Index>(rows_.size());
    const auto dot = [&](const VectorXd& a, Index i, const VectorXd& b, Index k) {
      return a.segment(first - i, n).dot(b.segment(first - k, n));
    };
    const auto next = [&](double sum, const VectorXd& a, Index i, const VectorXd& b, Index k) {
      return sum + a[first - i - 1] * b[first - k - 1] - a[first - 1 - i + n] * b[first - 1 - k + n];
    };
    const Index q = kInputLags, p = lags_;
    MatrixXd own(q, q), mixed(1 + p, q);
    VectorXd with_target(q);
    for (Index k = 1; k <= q; ++k) {
      mixed(0, k - 1) = x.segment(first - k, n).sum();
      with_target[k - 1] = dot(output_, 0, x, k);
      own(0, k - 1) = dot(x, 1, x, k);
      mixed(1, k - 1) = k == 1 ? dot(output_, 1, x, 1) : next(with_target[k - 2], output_, 0, x, k - 1);
    }
    for (Index i = 2; i <= q; ++i) {
      for (Index k = i; k <= q; ++k) own(i - 1, k - 1) = next(own(i - 2, k - 2), x, i - 1, x, k - 1);
    }
    for (Index j = 2; j <= p; ++j) {
      mixed(j, 0) = dot(output_, j, x, 1);
      for (Index k = 2; k <= q; ++k) mixed(j, k - 1) = next(mixed(j - 1, k - 2), output_, j - 1, x, k - 1);
    }
    own.triangularView<Eigen::StrictlyLower>() = own.transpose();
    // Less what the output's past tells already.
    own -= mixed.transpose() * past_inverse_ * mixed;
    with_target -= mixed.transpose() * past_weights_;
    own.diagonal().array() += kRankTolerance * static_cast<double>(n);
    return left_by_past_.squaredNorm() - with_target.dot(solve_symmetric(own, with_target));
  }

  double log_ratio(const VectorXd& before, const VectorXd& after) const {
    return 0.5 * static_cast<double>(rows_.size()) *
           std::log(before.squaredNorm() / std::max(after.squaredNorm(), 1e-300));
  }

  /// Sine and cosine at a frequency [per sample] and its harmonics.
  MatrixXd wave(double frequency) const {
    std::vector<VectorXd> columns;
    for (int h = 1; h <= kHarmonics && h * frequency < 0.5; ++h) {
      const double turn = 2 * std::numbers::pi * h * frequency;
      VectorXd cosine(target_.size()), sine(target_.size());
      for (std::size_t i = 0; i < rows_.size(); ++i) {
        cosine[static_cast<Index>(i)] = std::cos(turn * static_cast<double>(rows_[i]));
        sine[static_cast<Index>(i)] = std::sin(turn * static_cast<double>(rows_[i]));
      }
      columns.push_back(std::move(cosine));
      columns.push_back(std::move(sine));
    }
    MatrixXd all(target_.size(), static_cast<Index>(columns.size()));
    for (std::size_t c = 0; c < columns.size(); ++c) all.col(static_cast<Index>(c)) = columns[c];
    return all;
  }

  /// The output's answer, so many samples later each, to a step of a signal.
  std::vector<double> step_answer(const VectorXd& signal, std::size_t samples) const {
    MatrixXd columns(target_.size(), 1 + lags_ + kInputLags);
    columns << VectorXd::Ones(target_.size()), lagged(output_, lags_), lagged(signal, kInputLags);
    const VectorXd weights = least_squares(columns, target_);
    std::vector<double> impulse(samples), step(samples);
    for (std::size_t t = 0; t < samples; ++t) {
      const auto at = static_cast<Index>(t);
      if (at < kInputLags) impulse[t] = weights[1 + lags_ + at];
      for (Index k = 0; k < std::min(lags_, at); ++k) {
        impulse[t] += weights[1 + k] * impulse[t - 1 - static_cast<std::size_t>(k)];
      }
      step[t] = impulse[t] + (t > 0 ? step[t - 1] : 0);
    }
    return step;
  }

  double input_scale = 1, output_scale = 1;

 private:
  /// As many past outputs as Akaike's criterion asks for (1974).
  void choose_lags() {
    double best = std::numeric_limits<double>::infinity();
    const auto n = static_cast<double>(rows_.size());
    for (const Index lags : kOutputLags) {
      if (lags > most_ || lags * kRowsPerLag > output_.size()) break;
      MatrixXd columns(target_.size(), 1 + 2 * lags);
      columns << VectorXd::Ones(target_.size()), lagged(output_, lags), lagged(input_, lags);
      const MatrixXd basis = basis_of(std::move(columns));
      const double value = n * std::log(left_of(target_, basis).squaredNorm()) + 2 * static_cast<double>(basis.cols());
      if (value >= best) continue;
      best = value;
      lags_ = lags;
    }
    MatrixXd columns(target_.size(), 1 + lags_);
    columns << VectorXd::Ones(target_.size()), lagged(output_, lags_);
    past_inverse_ = pseudo_inverse(columns.transpose() * columns);
    past_weights_ = past_inverse_ * (columns.transpose() * target_);
    past_ = basis_of(std::move(columns));
    left_by_past_ = left_of(target_, past_);
  }

  VectorXd input_, output_;
  std::vector<Index> rows_;
  Index most_ = 0, lags_ = kOutputLags.front();
  VectorXd target_, left_by_past_, past_weights_;
  MatrixXd past_, past_inverse_;  ///< constant and past outputs: their span, and the inverse of their products
};

/// A law on a signal and the squares that it leaves of the output.
struct Tried {
  Stick stick;
  double squares = std::numeric_limits<double>::infinity();
};

/// Every law tried on a signal, the best first: a grid, and finer steps from its best. One whose valve never moves is
/// not tried.
std::vector<Tried> search_laws(const OneStep& step, const VectorXd& signal) {
  std::vector<Tried> tried;
  const auto attempt = [&](const Stick& stick) {
    Tried now{stick};
    if (!(stick.band > 0) || stick.jump < 0 || stick.jump > stick.band) return now;
    const VectorXd held = passed_on(signal, stick);
    if (held.maxCoeff() <= held.minCoeff()) return now;
    now.squares = step.squares_left(held);
    tried.push_back(now);
    return now;
  };
  const auto sort = [&] {
    std::stable_sort(tried.begin(), tried.end(), [](const auto& a, const auto& b) { return a.squares < b.squares; });
  };
  const double range = range_of(signal);
  for (double share = kLeastBand; share < kMostBand; share *= kBandRatio) {
    for (int j = 0; j <= kJumps; ++j) {
      for (const bool slides : {false, true}) attempt({share * range, share * range * j / kJumps, slides});
    }
  }
  sort();
  const std::vector<Tried> best(tried.begin(),
                                tried.begin() + static_cast<std::ptrdiff_t>(std::min(kRefined, tried.size())));
  for (Tried at : best) {
    for (const double size : kFinerSteps) {
      const Stick from = at.stick;
      const double move = size * from.band;
      for (int band = -1; band <= 1; ++band) {
        for (int jump = -2; jump <= 2; ++jump) {
          const Tried now = attempt({from.band + band * move, from.jump + jump * move, from.slides});
          if (now.squares < at.squares) at = now;
        }
      }
    }
  }
  sort();
  return tried;
}

/// The input's increment by the present and two past outputs.
Eigen::Vector3d controller_of(const OneStep& step) {
  const VectorXd &u = step.input(), &y = step.output();
  const Index n = u.size() - 2;
  MatrixXd columns(n, 4);
  columns << y.tail(n), y.segment(1, n), y.head(n), VectorXd::Ones(n);
  return least_squares(columns, u.tail(n) - u.segment(1, n)).head(3);
}

/// The output's strongest line [per sample], of three periods in the recording or more, under Hann's window.
double strongest_line(const VectorXd& y) {
  const Index n = y.size();
  VectorXd windowed(n);
  for (Index t = 0; t < n; ++t) {
    windowed[t] = y[t] * (1 - std::cos(2 * std::numbers::pi * static_cast<double>(t) / static_cast<double>(n)));
  }
  const auto power = [&](double frequency) {
    const std::complex<double> turn = std::polar(1.0, 2 * std::numbers::pi * frequency);
    std::complex<double> phasor = 1, sum = 0;
    for (Index t = 0; t < n; ++t) {
      sum += phasor * windowed[t];
      phasor *= turn;
    }
    return std::norm(sum);
  };
  const double grid = 0.5 / static_cast<double>(n);
  double best = 6 * grid, highest = 0;
  const auto attempt = [&](double frequency) {
    const double now = power(frequency);
    if (now <= highest) return;
    highest = now;
    best = frequency;
  };
  for (double f = 6 * grid; f < 0.5; f += grid) attempt(f);
  const double centre = best;
  for (int i = -8; i <= 8; ++i) attempt(centre + i * grid / 8);
  return best;
}

/// Whether a law driven by anything else that the loop moves gains as much as by the input.
bool is_driven_by_input(const OneStep& step, const Eigen::Vector3d& controller, double squares) {
  const VectorXd &u = step.input(), &y = step.output();
  const VectorXd proportional = controller[0] * y;
  const double worst = squares * std::exp(2 * kOverOtherDrivers / static_cast<double>(step.left(u, 1).size()));
  for (const VectorXd& driver : {VectorXd(behind_lag(u, 2)), VectorXd(behind_lag(u, 5)), VectorXd(u - proportional),
                                 VectorXd(u + proportional), y}) {
    const std::vector<Tried> laws = search_laws(step, driver);
    if (!laws.empty() && laws.front().squares < worst) return false;
  }
  return true;
}

/// Whether the output follows the valve in the sense in which the controller, that acts against it, takes it to.
bool answers_as_controlled(const OneStep& step, const Eigen::Vector3d& controller, const VectorXd& held) {
  const std::vector<double> answer = step.step_answer(held, 12);
  const double sense = controller.sum() < 0 ? 1 : -1;
  return sense * answer[5] > 0 && sense * answer[10] > 0;
}

/// Samples at which a valve stands, and how often it sets off in either sense.
bool rests_and_moves(const VectorXd& held, double& rest_share) {
  Index rests = 0;
  int up = 0, down = 0;
  for (Index t = 1; t < held.size(); ++t) {
    const double move = held[t] - held[t - 1];
    rests += move == 0 ? 1 : 0;
    const bool sets_off = move != 0 && (t == 1 || move * (held[t - 1] - held[t - 2]) <= 0);
    if (sets_off) ++(move > 0 ? up : down);
  }
  rest_share = static_cast<double>(rests) / static_cast<double>(held.size() - 1);
  return rest_share >= kLeastRest && up >= kLeastMoves && down >= kLeastMoves;
}

/// Gains in log likelihood per sample, one for each of equal stretches.
std::vector<double> block_gains(const VectorXd& before, const VectorXd& after) {
  const Index n = before.size();
  const double a = before.squaredNorm() / static_cast<double>(n), b = after.squaredNorm() / static_cast<double>(n);
  std::vector<double> gains;
  for (Index i = 0; i < kBlocks; ++i) {
    const Index first = i * n / kBlocks, size = (i + 1) * n / kBlocks - first;
    const double mean = before.segment(first, size).squaredNorm() / a - after.segment(first, size).squaredNorm() / b;
    gains.push_back(0.5 * std::log(a / b) + 0.5 * mean / static_cast<double>(size));
  }
  return gains;
}

/// The range of laws that the likelihood does not tell from the best, at least half a step of the search wide.
void set_intervals(const std::vector<Tried>& laws, double rows, double scale, StickingLoop& loop) {
  const Stick best = laws.front().stick;
  const double least = 0.5 * kFinerSteps.back() * best.band;
  std::array<double, 2> breakaway{best.breakaway() - least, best.breakaway() + least};
  std::array<double, 2> kinetic{std::max(0.0, best.kinetic() - least), best.kinetic() + least};
  for (const Tried& law : laws) {
    if (0.5 * rows * std::log(law.squares / laws.front().squares) > kWithin95) break;
    breakaway = {std::min(breakaway[0], law.stick.breakaway()), std::max(breakaway[1], law.stick.breakaway())};
    kinetic = {std::min(kinetic[0], law.stick.kinetic()), std::max(kinetic[1], law.stick.kinetic())};
  }
  loop.breakaway = best.breakaway() * scale;
  loop.kinetic = best.kinetic() * scale;
  loop.breakaway_ci95 = {breakaway[0] * scale, breakaway[1] * scale};
  loop.kinetic_ci95 = {kinetic[0] * scale, kinetic[1] * scale};
}

}  // namespace

std::optional<StickingLoop> sticking_loop(const Recording& recording) {
  const std::size_t samples = std::min(recording.samples(), kMostSamples);
  if (samples < kFewestSamples) return std::nullopt;
  const OneStep step(recording, samples);
  if (!step.enough()) return std::nullopt;

  const Index input_lags = std::max(step.output_lags(), kInputLags);
  const VectorXd by_input = step.left(step.input(), input_lags);
  const std::vector<Tried> laws = search_laws(step, step.input());
  if (laws.empty()) return std::nullopt;
  const VectorXd held = passed_on(step.input(), laws.front().stick);
  const VectorXd by_valve = step.left(held, kInputLags);
  StickingLoop loop;
  loop.log_gain = step.log_ratio(by_input, by_valve);
  if (loop.log_gain < kLeastGain || !rests_and_moves(held, loop.rest_share)) return std::nullopt;

  const std::vector<double> gains = block_gains(by_input, by_valve);
  loop.blocks = kBlocks;
  loop.won = static_cast<int>(std::count_if(gains.begin(), gains.end(), [](double gain) { return gain > 0; }));
  loop.p_value = compare_blocks(std::vector<double>(gains.size(), 0.0), gains).p_value;
  if (loop.won < kLeastWon) return std::nullopt;

  const VectorXd by_both = step.left(held, kInputLags, step.lagged(step.input(), input_lags));
  const double all = step.log_ratio(by_input, by_both), of_input = step.log_ratio(by_valve, by_both);
  if (of_input > std::max(kMostOfInput, kMostShareOfInput * all)) return std::nullopt;
  const MatrixXd wave = step.wave(strongest_line(step.output()));
  const double of_wave = step.log_ratio(by_valve, step.left(held, kInputLags, wave));
  if (of_wave > 0.5 * static_cast<double>(wave.cols()) + kOverWave) return std::nullopt;
  const Eigen::Vector3d controller = controller_of(step);
  if (!answers_as_controlled(step, controller, held)) return std::nullopt;
  if (!is_driven_by_input(step, controller, laws.front().squares)) return std::nullopt;

  const auto rows = static_cast<double>(by_valve.size());
  for (const Tried& law : laws) {
    if (law.stick.jump > 0.1 * law.stick.band) continue;
    loop.log_gain_play = loop.log_gain - 0.5 * rows * std::log(law.squares / laws.front().squares);
    break;
  }
  set_intervals(laws, rows, step.input_scale, loop);
  return loop;
}

}  // namespace valvetriage
