#include "core/identify/valve_fit_problem.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/residual/noise_floor.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

enum Parameter : Index { kFrequency, kDamping, kDelay, kLoop, kTimeConstant, kExponent, kSupply };
enum Start : Index { kSpoolRate, kSpoolPosition, kPressureGap, kMemory };

// Physics' own preferences where no population is known.
constexpr double kExponentMean = 0.6, kExponentSd = 0.25;
constexpr double kSupplyOverReference = 5.0, kSupplyLogSd = 0.7;  // reference is half of the largest pressure
// Second differences of the map over one knot are a few psi at most on a valve of 200 psi; ten of them are allowed.
constexpr double kMapBend_psi = 30.0;
// A recording that does not begin at rest is off by no more than this in its map's input and its pressure.
constexpr double kSpoolStartSd_a = 0.05, kPressureStartSd_psi = 20.0, kMemorySd = 0.5;

struct Between {
  Index left = 0;
  double share = 0;
};

/// Position of x between equidistant knots; the end pieces reach beyond.
Between locate(const std::vector<double>& knots, double x) {
  const double spacing = knots[1] - knots[0];
  const auto last = static_cast<Index>(knots.size()) - 2;
  const Index left = std::clamp<Index>(static_cast<Index>(std::floor((x - knots[0]) / spacing)), 0, last);
  return {left, (x - knots[static_cast<std::size_t>(left)]) / spacing};
}

}  // namespace

ValveFitProblem::ValveFitProblem(std::span<const Recording> recordings, const ValveFitOptions& options)
    : options_(options), knots_(static_cast<Index>(options.knots.size())) {
  for (const Recording& recording : recordings) {
    Prepared prepared{.recording = &recording, .input = input_between_samples(recording)};
    prepared.driver = loop_driver(prepared.input);
    const double noise = noise_floor(recording).rms;
    prepared.inverse_variance = noise > 0 ? 1.0 / (noise * noise) : 1.0;
    prepared_.push_back(std::move(prepared));
  }
  set_bounds();
  set_preferences();
}

void ValveFitProblem::set_bounds() {
  double period = std::numeric_limits<double>::infinity();
  double longest = 0;
  for (const Prepared& p : prepared_) {
    period = std::min(period, p.recording->sample_period_s);
    longest = std::max(longest, p.recording->sample_period_s * static_cast<double>(p.input.start.size()));
  }
  const double range = options_.knots.back() - options_.knots.front();
  const double reference = options_.reference_psi;
  lower_.resize(kParameters);
  upper_.resize(kParameters);
  step_.resize(kParameters);
  const auto bound = [&](Index j, double low, double high, double step) {
    lower_(j) = low;
    upper_(j) = high;
    step_(j) = step;
  };
  // Faster than the sampling shows, or slower than the record holds, is not to be told from these data.
  bound(kFrequency, std::log(4.0 / longest), std::log(2.0 / period), 1e-4);
  bound(kDamping, std::log(0.05), std::log(20.0), 1e-4);
  bound(kDelay, 0, 0.25 * longest, 1e-3 * period);
  bound(kLoop, 0, 0.5 * range, 1e-6);
  bound(kTimeConstant, std::log(0.2 * period), std::log(longest), 1e-4);
  bound(kExponent, 0.2, 1.5, 1e-4);
  bound(kSupply, std::log(2.05 * reference), std::log(200 * reference), 1e-4);
}

void ValveFitProblem::set_preferences() {
  if (options_.prior) {
    mean_ = options_.prior->mean;
    precision_ = options_.prior->covariance.ldlt().solve(MatrixXd::Identity(shared(), shared()));
    return;
  }
  mean_ = VectorXd::Zero(shared());
  precision_ = MatrixXd::Zero(shared(), shared());
  const auto prefer = [&](Index j, double mean, double sd) {
    mean_(j) = mean;
    precision_(j, j) = 1 / (sd * sd);
  };
  prefer(kExponent, kExponentMean, kExponentSd);
  prefer(kSupply, std::log(kSupplyOverReference * options_.reference_psi), kSupplyLogSd);
  constexpr double kStencil[3] = {1, -2, 1};
  for (Index k = 1; k + 1 < knots_; ++k) {
    for (Index i = 0; i < 3; ++i) {
      for (Index j = 0; j < 3; ++j) {
        precision_(kParameters + k - 1 + i, kParameters + k - 1 + j) +=
            kStencil[i] * kStencil[j] / (kMapBend_psi * kMapBend_psi);
      }
    }
  }
}

VectorXd ValveFitProblem::clamped(VectorXd v) const {
  v.head(kParameters) = v.head(kParameters).cwiseMax(lower_).cwiseMin(upper_);
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    double& memory = v(start_at(r) + kMemory);
    memory = std::clamp(memory, -1.0, 1.0);
  }
  return v;
}

VectorXd ValveFitProblem::start_vector(const ValveParameters& parameters) const {
  VectorXd v = VectorXd::Zero(size());
  v.head(kParameters) = to_vector(parameters);
  if (options_.prior) {
    v.segment(kParameters, knots_) = options_.prior->mean.tail(knots_);
    return clamped(v);
  }
  // Mean output around each knot, gaps filled by the smoothness of the map.
  MatrixXd a = precision_.bottomRightCorner(knots_, knots_);
  VectorXd b = VectorXd::Zero(knots_);
  for (const Prepared& p : prepared_) {
    for (std::size_t i = 0; i < p.input.start.size(); ++i) {
      if (!p.recording->is_valid(i)) continue;
      const Between at = locate(options_.knots, p.input.start[i]);
      const Index nearest = at.left + (at.share > 0.5 ? 1 : 0);
      a(nearest, nearest) += 1;
      b(nearest) += p.recording->output.values[i];
    }
  }
  const VectorXd knots = a.ldlt().solve(b);
  const std::vector<double> values(knots.data(), knots.data() + knots_);
  const std::vector<double> monotone = monotone_regression(values, std::vector<double>(values.size(), 1.0));
  v.segment(kParameters, knots_) = Eigen::Map<const VectorXd>(monotone.data(), knots_);
  return clamped(v);
}

StaticMap ValveFitProblem::map_of(const VectorXd& v) const {
  const double* first = v.data() + kParameters;
  return {options_.knots, std::vector<double>(first, first + knots_)};
}

void ValveFitProblem::run_spool(const VectorXd& v, std::size_t recording, std::vector<double>& position) const {
  const Prepared& prepared = prepared_[recording];
  const ValveParameters parameters = to_parameters(v.head(kParameters), options_.reference_psi);
  const MagneticLoop loop{.width_a = parameters.loop_width_a, .memory = v(start_at(recording) + kMemory)};
  const SampledValveDynamics spool(parameters.spool, prepared.recording->sample_period_s);
  position.resize(prepared.input.start.size());
  spool.run(loop.apply(prepared.input, prepared.driver), position);
  SampledValveDynamics::State free(2);
  free << v(start_at(recording) + kSpoolRate), v(start_at(recording) + kSpoolPosition);
  for (double& x : position) {
    if (free.squaredNorm() < 1e-24) break;  // decayed below any effect
    x += free(1);
    free = spool.transition().lazyProduct(free).eval();
  }
}

ValveFitProblem::Run ValveFitProblem::run(const VectorXd& v, std::size_t recording, bool tangents) const {
  Run run;
  run_spool(v, recording, run.position);
  run.steady = run.position;
  map_of(v).apply(run.steady);
  run.pressure.resize(run.steady.size());
  const ValveParameters parameters = to_parameters(v.head(kParameters), options_.reference_psi);
  const double first = run.steady.front() + v(start_at(recording) + kPressureGap);
  run_volume(parameters.volume, prepared_[recording].recording->sample_period_s, first, run.steady, run.pressure,
             tangents ? &run.tangent : nullptr);
  return run;
}

std::vector<double> ValveFitProblem::simulate(const VectorXd& v, std::size_t recording) const {
  return run(v, recording, false).pressure;
}

double ValveFitProblem::cost(const VectorXd& v) const {
  double sum = penalty(v);
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    const std::vector<double> simulated = simulate(v, r);
    const Recording& recording = *prepared_[r].recording;
    double squares = 0;
    for (std::size_t i = 0; i < simulated.size(); ++i) {
      if (!recording.is_valid(i)) continue;
      const double e = recording.output.values[i] - simulated[i];
      squares += e * e;
    }
    sum += squares * prepared_[r].inverse_variance;
  }
  return sum;
}

double ValveFitProblem::penalty(const VectorXd& v) const {
  const VectorXd d = v.head(shared()) - mean_;
  double sum = d.dot(precision_ * d);
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    const auto s = v.segment<kStarts>(start_at(r));
    sum +=
        (s(kSpoolRate) * s(kSpoolRate) + s(kSpoolPosition) * s(kSpoolPosition)) / (kSpoolStartSd_a * kSpoolStartSd_a) +
        std::pow(s(kPressureGap) / kPressureStartSd_psi, 2) + std::pow(s(kMemory) / kMemorySd, 2);
  }
  return sum;
}

void ValveFitProblem::add_penalty(const VectorXd& v, Normal& normal) const {
  normal.a.topLeftCorner(shared(), shared()) += precision_;
  normal.b.head(shared()) -= precision_ * (v.head(shared()) - mean_);
  const double weights[kStarts] = {1 / (kSpoolStartSd_a * kSpoolStartSd_a), 1 / (kSpoolStartSd_a * kSpoolStartSd_a),
                                   1 / (kPressureStartSd_psi * kPressureStartSd_psi), 1 / (kMemorySd * kMemorySd)};
  for (std::size_t r = 0; r < prepared_.size(); ++r) {
    for (Index s = 0; s < kStarts; ++s) {
      const Index at = start_at(r) + s;
      normal.a(at, at) += weights[s];
      normal.b(at) -= weights[s] * v(at);
    }
  }
}

/// Sensitivities of parameters and start values at one recording: differences before the map, carried on by the map's
/// slope and the volume's tangent; differences of the volume itself for its own parameters.
MatrixXd ValveFitProblem::nonlinear_columns(const VectorXd& v, std::size_t recording, const Run& base) const {
  const auto n = static_cast<Index>(base.pressure.size());
  MatrixXd columns(n, kParameters + kStarts);
  const StaticMap map = map_of(v);
  std::vector<double> slope(base.position.size());
  for (std::size_t i = 0; i < slope.size(); ++i) {
    const Between at = locate(options_.knots, base.position[i]);
    const auto left = static_cast<std::size_t>(at.left);
    slope[i] = (map.output[left + 1] - map.output[left]) / (map.input[left + 1] - map.input[left]);
  }
  std::vector<double> moved;
  const auto before_map = [&](Index entry, double step, Index column) {
    VectorXd w = v;
    w(entry) += step;
    run_spool(w, recording, moved);
    double change = 0;
    for (Index i = 0; i < n; ++i) {
      const auto at = static_cast<std::size_t>(i);
      const std::size_t next = std::min(at + 1, moved.size() - 1);
      const double here = slope[at] * (moved[at] - base.position[at]) / step;
      const double there = slope[next] * (moved[next] - base.position[next]) / step;
      if (i == 0) change = here;  // the volume starts at its steady pressure
      columns(i, column) = change;
      change = base.tangent.keep[at] * change + base.tangent.pass[at] * (here + there);
    }
  };
  const auto in_volume = [&](Index entry, double step, Index column) {
    VectorXd w = v;
    w(entry) += step;
    const OrificeVolume volume = to_parameters(w.head(kParameters), options_.reference_psi).volume;
    const double first = base.steady.front() + w(start_at(recording) + kPressureGap);
    moved.resize(base.steady.size());
    run_volume(volume, prepared_[recording].recording->sample_period_s, first, base.steady, moved);
    for (Index i = 0; i < n; ++i) {
      const auto at = static_cast<std::size_t>(i);
      columns(i, column) = (moved[at] - base.pressure[at]) / step;
    }
  };
  const auto inward = [&](Index j) { return v(j) + step_(j) > upper_(j) ? -step_(j) : step_(j); };
  for (const Index j : {kFrequency, kDamping, kDelay, kLoop}) before_map(j, inward(j), j);
  for (const Index j : {kTimeConstant, kExponent, kSupply}) in_volume(j, inward(j), j);
  const Index start = start_at(recording);
  before_map(start + kSpoolRate, 1e-5, kParameters + kSpoolRate);
  before_map(start + kSpoolPosition, 1e-5, kParameters + kSpoolPosition);
  in_volume(start + kPressureGap, 1e-3, kParameters + kPressureGap);
  const double memory_step = v(start + kMemory) > 0 ? -0.01 : 0.01;
  before_map(start + kMemory, memory_step, kParameters + kMemory);
  return columns;
}

void ValveFitProblem::accumulate(const VectorXd& v, std::size_t recording, Normal& normal) const {
  constexpr Index kBlock = 256;
  const Recording& measured = *prepared_[recording].recording;
  const Run base = run(v, recording, true);
  const MatrixXd nonlinear = nonlinear_columns(v, recording, base);
  const auto n = static_cast<Index>(base.pressure.size());
  const Index local = kParameters + knots_ + kStarts;

  MatrixXd block(local, kBlock);
  VectorXd error(kBlock);
  MatrixXd a = MatrixXd::Zero(local, local);
  VectorXd b = VectorXd::Zero(local);
  Index filled = 0;
  const auto flush = [&] {
    if (filled == 0) return;  // Eigen divides by the width of a product
    a.selfadjointView<Eigen::Lower>().rankUpdate(block.leftCols(filled));
    b.noalias() += block.leftCols(filled) * error.head(filled);
    filled = 0;
  };
  VectorXd knot = VectorXd::Zero(knots_);
  Between here = locate(options_.knots, base.position.front());
  knot(here.left) = 1 - here.share;
  knot(here.left + 1) = here.share;
  for (Index i = 0; i < n; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (measured.is_valid(at)) {
      block.col(filled).head(kParameters) = nonlinear.row(i).head(kParameters);
      block.col(filled).segment(kParameters, knots_) = knot;
      block.col(filled).tail(kStarts) = nonlinear.row(i).tail(kStarts);
      error(filled) = measured.output.values[at] - base.pressure[at];
      if (++filled == kBlock) flush();
    }
    const Between there = locate(options_.knots, base.position[std::min(at + 1, base.position.size() - 1)]);
    knot *= base.tangent.keep[at];
    for (const Between& side : {here, there}) {
      knot(side.left) += base.tangent.pass[at] * (1 - side.share);
      knot(side.left + 1) += base.tangent.pass[at] * side.share;
    }
    here = there;
  }
  flush();

  const double weight = prepared_[recording].inverse_variance;
  const Index starts = start_at(recording);
  normal.a.topLeftCorner(shared(), shared()).triangularView<Eigen::Lower>() +=
      weight * a.topLeftCorner(shared(), shared());
  normal.a.block(starts, 0, kStarts, shared()) += weight * a.bottomLeftCorner(kStarts, shared());
  normal.a.block(starts, starts, kStarts, kStarts).triangularView<Eigen::Lower>() +=
      weight * a.bottomRightCorner(kStarts, kStarts);
  normal.b.head(shared()) += weight * b.head(shared());
  normal.b.segment(starts, kStarts) += weight * b.tail(kStarts);
}

ValveFitProblem::Normal ValveFitProblem::linearise(const VectorXd& v) const {
  Normal normal{MatrixXd::Zero(size(), size()), VectorXd::Zero(size())};
  for (std::size_t r = 0; r < prepared_.size(); ++r) accumulate(v, r, normal);
  normal.a.triangularView<Eigen::StrictlyUpper>() = normal.a.transpose();
  add_penalty(v, normal);
  return normal;
}

}  // namespace valvetriage
