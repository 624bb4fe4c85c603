#include "core/identify/valve_fit.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "core/residual/noise_floor.h"

namespace valvetriage {
namespace {

constexpr double kKnotSpacingA = 0.025;
// Sensitivities are differences: a step of 1e-4 in a logarithm, far above rounding, far below any curvature.
constexpr double kLogStep = 1e-4;
// Weight of the map's smoothness where there is no prior, relative to the mean diagonal of the normal equations: it
// fills knots that no sample visited and moves a visited one by less than a thousandth of its standard error.
constexpr double kSmoothness = 1e-7;
// Natural frequencies are kept below what the sampling shows and above what the record holds.
constexpr double kSlowestPeriodsOfRecord = 4.0;

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Where a value lies between the knots: output = (1 − share) knot[left] + share knot[left + 1].
struct HatPosition {
  std::uint32_t left = 0;
  double share = 0;
};

HatPosition locate(const std::vector<double>& knots, double u) {
  const auto above = std::upper_bound(knots.begin() + 1, knots.end() - 1, u);
  const auto left = static_cast<std::uint32_t>(above - knots.begin() - 1);
  return {left, (u - knots[left]) / (knots[left + 1] - knots[left])};
}

/// One recording, its inputs located once.
struct Prepared {
  const Recording* recording = nullptr;
  std::vector<HatPosition> start, end;
  double inverse_variance = 1;
};

Prepared prepare(const Recording& recording, const std::vector<double>& knots) {
  const IntervalSignal input = input_between_samples(recording);
  Prepared prepared{.recording = &recording};
  prepared.start.reserve(input.start.size());
  prepared.end.reserve(input.end.size());
  for (const double u : input.start) prepared.start.push_back(locate(knots, u));
  for (const double u : input.end) prepared.end.push_back(locate(knots, u));
  const double noise = noise_floor(recording).rms;
  prepared.inverse_variance = noise > 0 ? 1.0 / (noise * noise) : 1.0;
  return prepared;
}

double value_at(const VectorXd& knots, HatPosition at) {
  return knots(at.left) + at.share * (knots(at.left + 1) - knots(at.left));
}

IntervalSignal through_map(const Prepared& prepared, const VectorXd& knots) {
  IntervalSignal signal;
  const std::size_t n = prepared.start.size();
  signal.start.resize(n);
  signal.end.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    signal.start[i] = value_at(knots, prepared.start[i]);
    signal.end[i] = value_at(knots, prepared.end[i]);
  }
  return signal;
}

/// Normal equations of one linearisation: parameters [dynamics | knots | initial states of each recording].
struct Normal {
  MatrixXd a;
  VectorXd b;
  double cost = 0;  ///< Σ e² / σ²
};

class Problem {
 public:
  Problem(std::span<const Recording> recordings, const ValveFitOptions& options)
      : options_(options), knots_(static_cast<Index>(options.knots.size())), dynamic_(options.order + 1) {
    for (const Recording& recording : recordings) prepared_.push_back(prepare(recording, options.knots));
    states_ = static_cast<Index>(prepared_.size()) * options.order;
    if (options.prior) {
      prior_precision_ =
          options.prior->covariance.ldlt().solve(MatrixXd::Identity(dynamic_ + knots_, dynamic_ + knots_));
      prior_mean_.resize(dynamic_ + knots_);
      prior_mean_ << to_vector(options.prior->dynamics),
          Eigen::Map<const VectorXd>(options.prior->map.output.data(), knots_);
    }
    set_limits();
  }

  Index size() const { return dynamic_ + knots_ + states_; }
  Index dynamic() const { return dynamic_; }
  Index knots() const { return knots_; }

  VectorXd clamped(VectorXd v) const {
    for (Index i = 0; i < dynamic_; ++i) v(i) = std::clamp(v(i), lower_(i), upper_(i));
    return v;
  }

  /// Sum of weighted squares at a parameter vector, prior and smoothness included.
  double cost(const VectorXd& v) const {
    double sum = penalty(v);
    std::vector<double> run;
    for (std::size_t r = 0; r < prepared_.size(); ++r) {
      simulate(v, r, run);
      const Recording& recording = *prepared_[r].recording;
      double squares = 0;
      for (std::size_t i = 0; i < run.size(); ++i) {
        if (!recording.is_valid(i)) continue;
        const double e = recording.output.values[i] - run[i];
        squares += e * e;
      }
      sum += squares * prepared_[r].inverse_variance;
    }
    return sum;
  }

  void simulate(const VectorXd& v, std::size_t r, std::vector<double>& run) const {
    const Prepared& prepared = prepared_[r];
    const SampledValveDynamics sampled(to_dynamics(v.head(dynamic_)), prepared.recording->sample_period_s);
    run.resize(prepared.start.size());
    sampled.run(through_map(prepared, v.segment(dynamic_, knots_)), run);
    add_free_response(sampled, v.segment(dynamic_ + knots_ + first_state(r), options_.order), run);
  }

  Normal linearise(const VectorXd& v) const {
    Normal normal{MatrixXd::Zero(size(), size()), VectorXd::Zero(size()), penalty(v)};
    for (std::size_t r = 0; r < prepared_.size(); ++r) accumulate(v, r, normal);
    add_penalty(v, normal);
    normal.a.triangularView<Eigen::StrictlyUpper>() = normal.a.transpose();
    return normal;
  }

  /// Knots and initial states that fit best under fixed dynamics, in place: linear least squares.
  void solve_linear(VectorXd& v) const {
    const Normal normal = linearise(v);
    const Index linear = knots_ + states_;
    const MatrixXd a = normal.a.bottomRightCorner(linear, linear);
    v.tail(linear) += a.ldlt().solve(normal.b.tail(linear));
  }

  void set_smoothness(double weight) { smoothness_ = weight; }

 private:
  Index first_state(std::size_t r) const { return static_cast<Index>(r) * options_.order; }

  void set_limits() {
    double fastest_period = prepared_.front().recording->sample_period_s;
    double longest = 0;
    for (const Prepared& p : prepared_) {
      fastest_period = std::min(fastest_period, p.recording->sample_period_s);
      longest = std::max(longest, p.recording->sample_period_s * static_cast<double>(p.start.size()));
    }
    const double fast = std::log(2.0 / fastest_period);
    const double slow = std::log(1.0 / (kSlowestPeriodsOfRecord * longest));
    lower_ = VectorXd::Constant(dynamic_, -fast);
    upper_ = VectorXd::Constant(dynamic_, -slow);
    lower_(0) = slow;
    upper_(0) = fast;
    lower_(1) = std::log(0.05);
    upper_(1) = std::log(20.0);
    lower_(dynamic_ - 1) = 0;
    upper_(dynamic_ - 1) = 0.25 * longest;
  }

  static void add_free_response(const SampledValveDynamics& sampled, const VectorXd& state, std::vector<double>& run) {
    SampledValveDynamics::State x = state;
    const Index last = x.size() - 1;
    for (double& y : run) {
      y += x(last);
      x = sampled.transition().lazyProduct(x).eval();
    }
  }

  double penalty(const VectorXd& v) const {
    if (options_.prior) {
      const VectorXd d = v.head(dynamic_ + knots_) - prior_mean_;
      return d.dot(prior_precision_ * d);
    }
    double sum = 0;
    for (Index k = 1; k + 1 < knots_; ++k) {
      const double bend = second_difference(v, k);
      sum += smoothness_ * bend * bend;
    }
    return sum;
  }

  double second_difference(const VectorXd& v, Index k) const {
    const Index at = dynamic_ + k;
    return v(at - 1) - 2 * v(at) + v(at + 1);
  }

  void add_penalty(const VectorXd& v, Normal& normal) const {
    if (options_.prior) {
      const Index p = dynamic_ + knots_;
      normal.a.topLeftCorner(p, p) += prior_precision_;
      normal.b.head(p) -= prior_precision_ * (v.head(p) - prior_mean_);
      return;
    }
    constexpr double kStencil[3] = {1, -2, 1};
    for (Index k = 1; k + 1 < knots_; ++k) {
      const double bend = second_difference(v, k);
      for (Index i = 0; i < 3; ++i) {
        normal.b(dynamic_ + k - 1 + i) -= smoothness_ * kStencil[i] * bend;
        for (Index j = 0; j < 3; ++j) {
          normal.a(dynamic_ + k - 1 + i, dynamic_ + k - 1 + j) += smoothness_ * kStencil[i] * kStencil[j];
        }
      }
    }
  }

  /// Columns of the dynamics at one recording: differences of simulations.
  MatrixXd dynamic_columns(const VectorXd& v, std::size_t r, const std::vector<double>& run) const {
    MatrixXd columns(static_cast<Index>(run.size()), dynamic_);
    std::vector<double> moved;
    for (Index j = 0; j < dynamic_; ++j) {
      const bool is_delay = j == dynamic_ - 1;
      double step = is_delay ? 1e-3 * prepared_[r].recording->sample_period_s : kLogStep;
      if (v(j) + step > upper_(j)) step = -step;
      VectorXd w = v;
      w(j) += step;
      simulate(w, r, moved);
      for (std::size_t i = 0; i < run.size(); ++i) columns(static_cast<Index>(i), j) = (moved[i] - run[i]) / step;
    }
    return columns;
  }

  /// Adds one recording's JᵀJ and Jᵀe, in blocks of rows so that no n × p matrix is held.
  void accumulate(const VectorXd& v, std::size_t r, Normal& normal) const {
    constexpr Index kBlock = 256;
    const Prepared& prepared = prepared_[r];
    const Recording& recording = *prepared.recording;
    const SampledValveDynamics sampled(to_dynamics(v.head(dynamic_)), recording.sample_period_s);
    std::vector<double> run;
    simulate(v, r, run);
    const MatrixXd dynamic = dynamic_columns(v, r, run);
    const Index n = static_cast<Index>(run.size());
    const Index order = options_.order;
    const Index local = dynamic_ + knots_ + order;
    const Index state_at = dynamic_ + knots_ + first_state(r);

    // Knot responses (order × knots) and the free response (order × order) run along with the samples.
    MatrixXd x = MatrixXd::Zero(order, knots_);
    const HatPosition first = prepared.start.front();
    x.col(first.left) += sampled.steady() * (1 - first.share);
    x.col(first.left + 1) += sampled.steady() * first.share;
    MatrixXd free = MatrixXd::Identity(order, order);
    MatrixXd next(order, knots_);

    // Local columns are [dynamics | knots | this recording's state]; the normal equations are built on those.
    MatrixXd block(local, kBlock);
    VectorXd error(kBlock);
    MatrixXd a = MatrixXd::Zero(local, local);
    VectorXd b = VectorXd::Zero(local);
    Index filled = 0;
    const auto flush = [&] {
      a.selfadjointView<Eigen::Lower>().rankUpdate(block.leftCols(filled));
      b.noalias() += block.leftCols(filled) * error.head(filled);
      filled = 0;
    };
    for (Index i = 0; i < n; ++i) {
      const auto at = static_cast<std::size_t>(i);
      if (recording.is_valid(at)) {
        block.col(filled).head(dynamic_) = dynamic.row(i);
        block.col(filled).segment(dynamic_, knots_) = x.row(order - 1);
        block.col(filled).tail(order) = free.row(order - 1);
        error(filled) = recording.output.values[at] - run[at];
        normal.cost += error(filled) * error(filled) * prepared.inverse_variance;
        if (++filled == kBlock) flush();
      }
      advance(sampled, prepared, at, x, next);
      free = sampled.transition() * free;
    }
    flush();
    scatter(a, b, prepared.inverse_variance, state_at, normal);
  }

  void advance(const SampledValveDynamics& sampled, const Prepared& prepared, std::size_t i, MatrixXd& x,
               MatrixXd& next) const {
    next.noalias() = sampled.transition().lazyProduct(x);
    const std::size_t delay = sampled.whole_delay();
    const auto add = [&](int g, HatPosition at) {
      next.col(at.left) += sampled.gain(g) * (1 - at.share);
      next.col(at.left + 1) += sampled.gain(g) * at.share;
    };
    const HatPosition before = prepared.start.front();
    const bool has_head = i >= delay;
    const bool has_tail = i >= delay + 1;
    const std::size_t m = has_head ? i - delay : 0;
    add(0, has_tail ? prepared.start[m - 1] : before);
    add(1, has_tail ? prepared.end[m - 1] : before);
    add(2, has_head ? prepared.start[m] : before);
    add(3, has_head ? prepared.end[m] : before);
    x.swap(next);
  }

  void scatter(const MatrixXd& a, const VectorXd& b, double weight, Index state_at, Normal& normal) const {
    const Index shared = dynamic_ + knots_;
    const Index order = options_.order;
    normal.a.topLeftCorner(shared, shared).triangularView<Eigen::Lower>() += weight * a.topLeftCorner(shared, shared);
    normal.a.block(state_at, 0, order, shared) += weight * a.bottomLeftCorner(order, shared);
    normal.a.block(state_at, state_at, order, order).triangularView<Eigen::Lower>() +=
        weight * a.bottomRightCorner(order, order);
    normal.b.head(shared) += weight * b.head(shared);
    normal.b.segment(state_at, order) += weight * b.tail(order);
  }

  const ValveFitOptions& options_;
  std::vector<Prepared> prepared_;
  Index knots_, dynamic_, states_ = 0;
  MatrixXd prior_precision_;
  VectorXd prior_mean_;
  VectorXd lower_, upper_;
  double smoothness_ = 0;
};

struct Descent {
  VectorXd v;
  double cost = 0;
  int iterations = 0;
  FitTermination termination = FitTermination::kIterationLimit;
};

/// Levenberg-Marquardt on the whole vector; the damping acts on the dynamics alone, the rest is linear.
Descent descend(const Problem& problem, VectorXd v, int most_iterations) {
  constexpr double kSmallestGain = 1e-9;  // relative decrease that no longer matters
  Descent descent{.v = std::move(v)};
  descent.cost = problem.cost(descent.v);
  double damping = 1e-3;
  for (descent.iterations = 0; descent.iterations < most_iterations; ++descent.iterations) {
    const Normal normal = problem.linearise(descent.v);
    bool accepted = false;
    double gain = 0;
    for (int attempt = 0; attempt < 8 && !accepted; ++attempt) {
      MatrixXd a = normal.a;
      for (Index j = 0; j < problem.dynamic(); ++j) a(j, j) *= 1 + damping;
      const VectorXd tried = problem.clamped(descent.v + a.ldlt().solve(normal.b));
      const double cost = problem.cost(tried);
      if (std::isfinite(cost) && cost < descent.cost) {
        gain = (descent.cost - cost) / descent.cost;
        descent.v = tried;
        descent.cost = cost;
        damping = std::max(damping / 5, 1e-9);
        accepted = true;
      } else {
        damping *= 8;
      }
    }
    if (!accepted) {
      descent.termination = FitTermination::kNoDescent;
      return descent;
    }
    if (gain < kSmallestGain) {
      descent.termination = FitTermination::kConverged;
      return descent;
    }
  }
  return descent;
}

/// Starting points for the dynamics: the population's mean, or a fan of natural frequencies.
std::vector<ValveDynamics> starts(const ValveFitOptions& options, std::span<const Recording> recordings) {
  if (options.prior) return {options.prior->dynamics};
  if (options.start) return {*options.start};
  const double period = recordings.front().sample_period_s;
  std::vector<ValveDynamics> fan;
  for (const double samples : {4.0, 12.0, 40.0}) {
    ValveDynamics dynamics{
        .delay_s = period, .natural_frequency_rad_s = 1.0 / (samples * period), .damping_ratio = 1.0};
    for (int i = 2; i < options.order; ++i) dynamics.lag_s.push_back(0.5 * samples * period / (i - 1));
    fan.push_back(dynamics);
  }
  return fan;
}

VectorXd start_vector(const Problem& problem, const ValveDynamics& dynamics, const ValveFitOptions& options) {
  VectorXd v = VectorXd::Zero(problem.size());
  v.head(problem.dynamic()) = to_vector(dynamics);
  if (options.prior) {
    v.segment(problem.dynamic(), problem.knots()) =
        Eigen::Map<const VectorXd>(options.prior->map.output.data(), problem.knots());
  }
  v = problem.clamped(std::move(v));
  problem.solve_linear(v);
  return v;
}

}  // namespace

VectorXd to_vector(const ValveDynamics& dynamics) {
  VectorXd v(dynamics.order() + 1);
  v(0) = std::log(dynamics.natural_frequency_rad_s);
  v(1) = std::log(dynamics.damping_ratio);
  for (std::size_t i = 0; i < dynamics.lag_s.size(); ++i) v(static_cast<Index>(2 + i)) = std::log(dynamics.lag_s[i]);
  v(v.size() - 1) = dynamics.delay_s;
  return v;
}

ValveDynamics to_dynamics(const VectorXd& v) {
  ValveDynamics dynamics;
  dynamics.natural_frequency_rad_s = std::exp(v(0));
  dynamics.damping_ratio = std::exp(v(1));
  for (Index i = 2; i + 1 < v.size(); ++i) dynamics.lag_s.push_back(std::exp(v(i)));
  dynamics.delay_s = v(v.size() - 1);
  return dynamics;
}

ValveDynamics canonical(const ValveDynamics& dynamics) {
  ValveDynamics ordered = dynamics;
  const double zeta = dynamics.damping_ratio;
  if (zeta > 1 && !dynamics.lag_s.empty()) {
    // Time constants of the pair: ωn² = 1 / (τ₁ τ₂), 2 ζ / ωn = τ₁ + τ₂.
    const double wn = dynamics.natural_frequency_rad_s;
    const double root = std::sqrt(zeta * zeta - 1);
    std::vector<double> tau = dynamics.lag_s;
    tau.push_back((zeta + root) / wn);
    tau.push_back((zeta - root) / wn);
    std::sort(tau.begin(), tau.end(), std::greater<>());
    ordered.natural_frequency_rad_s = 1.0 / std::sqrt(tau[0] * tau[1]);
    ordered.damping_ratio = 0.5 * (tau[0] + tau[1]) * ordered.natural_frequency_rad_s;
    ordered.lag_s.assign(tau.begin() + 2, tau.end());
  } else {
    std::sort(ordered.lag_s.begin(), ordered.lag_s.end(), std::greater<>());
  }
  return ordered;
}

Result<std::vector<double>> map_knots(std::span<const Recording> recordings) {
  double low = std::numeric_limits<double>::infinity();
  double high = -low;
  for (const Recording& recording : recordings) {
    const auto [least, most] = std::minmax_element(recording.input.values.begin(), recording.input.values.end());
    low = std::min(low, *least);
    high = std::max(high, *most);
  }
  if (!(high > low))
    return fail("constant_input", "the input of these recordings never changes, so no map can be learned");
  const double first = std::floor(low / kKnotSpacingA) * kKnotSpacingA;
  const auto pieces = std::max(1L, std::lround(std::ceil((high - first) / kKnotSpacingA - 1e-9)));
  std::vector<double> knots;
  for (long i = 0; i <= pieces; ++i) knots.push_back(first + static_cast<double>(i) * kKnotSpacingA);
  return knots;
}

Result<ValveFit> fit_valve(std::span<const Recording> recordings, const ValveFitOptions& options) {
  if (recordings.empty()) return fail("no_recordings", "a valve cannot be fitted without a recording");
  if (options.knots.size() < 2) return fail("no_knots", "the static map needs at least two knots");
  for (const Recording& recording : recordings) {
    if (!recording.has_valve_units()) {
      return fail("units", fmt::format("'{}' is not in A and psi, so it cannot be fitted as a valve", recording.name));
    }
  }
  Problem problem(recordings, options);
  if (!options.prior) {
    VectorXd probe = VectorXd::Zero(problem.size());
    probe.head(problem.dynamic()) = to_vector(starts(options, recordings).front());
    const MatrixXd a = problem.linearise(problem.clamped(probe)).a;
    problem.set_smoothness(kSmoothness * a.diagonal().segment(problem.dynamic(), problem.knots()).mean());
  }

  // Every start gets a few steps, the best of them the rest.
  constexpr int kScoutIterations = 4;
  const auto fan = starts(options, recordings);
  Descent best;
  best.cost = std::numeric_limits<double>::infinity();
  for (const ValveDynamics& start : fan) {
    Descent found = descend(problem, start_vector(problem, start, options),
                            fan.size() > 1 ? kScoutIterations : options.most_iterations);
    if (found.cost < best.cost) best = std::move(found);
  }
  if (best.termination == FitTermination::kIterationLimit && fan.size() > 1) {
    best = descend(problem, std::move(best.v), options.most_iterations);
  }

  ValveFit fit;
  fit.termination = best.termination;
  fit.iterations = best.iterations;
  const Index p = problem.dynamic() + problem.knots();
  const Normal normal = problem.linearise(best.v);
  fit.covariance = normal.a.ldlt().solve(MatrixXd::Identity(problem.size(), problem.size())).topLeftCorner(p, p);
  std::vector<double> knots(static_cast<std::size_t>(problem.knots()));
  std::vector<double> weights(knots.size());
  for (std::size_t k = 0; k < knots.size(); ++k) {
    const Index at = problem.dynamic() + static_cast<Index>(k);
    knots[k] = best.v(at);
    weights[k] = 1.0 / std::max(fit.covariance(at, at), 1e-12);
  }
  fit.map = {options.knots, monotone_regression(knots, weights)};
  best.v.segment(problem.dynamic(), problem.knots()) =
      Eigen::Map<const VectorXd>(fit.map.output.data(), problem.knots());
  fit.dynamics = to_dynamics(best.v.head(problem.dynamic()));

  double squares = 0;
  double count = 0;
  fit.simulated.resize(recordings.size());
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    problem.simulate(best.v, r, fit.simulated[r]);
    for (std::size_t i = 0; i < fit.simulated[r].size(); ++i) {
      if (!recordings[r].is_valid(i)) continue;
      const double e = recordings[r].output.values[i] - fit.simulated[r][i];
      squares += e * e;
      count += 1;
    }
  }
  fit.rmse = count > 0 ? std::sqrt(squares / count) : 0;
  return fit;
}

Model to_model(const ValveFit& fit) {
  Model model;
  model.kind = "valve";
  model.input_unit = "A";
  model.output_unit = "psi";
  model.map = fit.map;
  model.dynamics = to_transfer_function(fit.dynamics);
  return model;
}

}  // namespace valvetriage
