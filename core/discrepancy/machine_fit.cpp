#include "core/discrepancy/machine_fit.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/identify/spectrum.h"
#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kRelativeStep = 1e-5;
constexpr double kConverged = 1e-6;  // relative drop of the squared error that counts as none
constexpr double kDampingStart = 1e-3;
constexpr double kMostDamping = 1e8;

std::size_t longest(const MachineData& data) {
  std::size_t most = 2;
  for (const MachineRecord& record : data.records) most = std::max(most, record.input.size());
  return most;
}

/// The signals that enter each block, and the last one's output.
using Chain = std::vector<std::vector<double>>;

std::span<const double> start_of(const MachineFit& fit, std::size_t record, std::size_t block) {
  std::size_t at = 0;
  for (std::size_t b = 0; b < block; ++b) at += start_size(fit.machine.blocks[b]);
  return std::span(fit.starts[record]).subspan(at, start_size(fit.machine.blocks[block]));
}

/// Runs blocks from `first` on over a signal, in place.
void run_from(const MachineFit& fit, const MachineRecord& record, std::size_t index, std::size_t first,
              std::vector<double>& signal) {
  for (std::size_t b = first; b < fit.machine.blocks.size(); ++b) {
    run_block(fit.machine.blocks[b], fit.machine.sample_period_s, around(record), start_of(fit, index, b), signal,
              signal);
  }
}

Chain run_chain(const MachineFit& fit, const MachineRecord& record, std::size_t index) {
  Chain chain;
  std::vector<double> signal = record.input;
  for (std::size_t b = 0; b < fit.machine.blocks.size(); ++b) {
    chain.push_back(signal);
    run_block(fit.machine.blocks[b], fit.machine.sample_period_s, around(record), start_of(fit, index, b), signal,
              signal);
  }
  chain.push_back(std::move(signal));
  return chain;
}

double transformed(const FreeParameter& p, double value) {
  return p.logarithmic ? std::log(std::max(value, 1e-300)) : value;
}
double restored(const FreeParameter& p, double moved) {
  return std::clamp(p.logarithmic ? std::exp(std::clamp(moved, -690.0, 690.0)) : moved, p.lower, p.upper);
}

/// A value a little away from where it stands, inside its bounds, and how far that is in the transformed scale.
double probe(const Machine& machine, const FreeParameter& p, double& distance) {
  const double value = value_of(machine, p);
  const double step = kRelativeStep * (p.logarithmic ? value : std::max(std::abs(value), 0.1 * p.unit));
  const double moved = value + step <= p.upper ? value + step : value - step;
  distance = transformed(p, moved) - transformed(p, value);
  return moved;
}

void keep_stable(Machine& machine, const SectionLimits& limits) {
  for (MachineBlock& block : machine.blocks) {
    for (Section& section : block.sections) section = clamped(section, limits);
  }
}

/// ln(slow rate / rate) of each section that is slower than the record can tell, times the rms: one unit of χ² each.
double slow_mode_cost(const Machine& machine, const SectionLimits& limits, double variance) {
  double cost = 0;
  for (const MachineBlock& block : machine.blocks) {
    for (const Section& section : block.sections) {
      const double slow = std::log(limits.slow_rate / slowest_rate(section));
      if (slow > 0) cost += variance * slow * slow;
    }
  }
  return cost;
}

/// Normal equations of shared parameters first, then each record's start.
struct Normal {
  MatrixXd a;
  VectorXd g;
};

class Refiner {
 public:
  Refiner(const MachineData& data, const MachineRows& rows, MachineFit& fit, MachineBudget& budget, bool shared)
      : data_(data), rows_(rows), fit_(fit), budget_(budget), limits_(longest(data)), shared_(shared) {
    states_ = start_size(fit.machine);
    for (const FreeParameter& p : fit.free) {
      if (shared) units_.push_back(p.logarithmic ? 1 : p.unit);
    }
    const std::vector<double> of_start = units_of_start(fit.machine);
    for (std::size_t r = 0; r < data.records.size(); ++r) {
      units_.insert(units_.end(), of_start.begin(), of_start.end());
    }
    for (auto& start : fit_.starts) start.resize(states_);
    fit_.starts.resize(data.records.size(), std::vector<double>(states_));
  }

  void run(int iterations) {
    keep_stable(fit_.machine, limits_);
    fit_.squares = squares_of(fit_);
    fit_.rows = count();
    fit_.failed = !std::isfinite(fit_.squares);
    if (fit_.failed) return;
    double damping = kDampingStart;
    int calm = 0;
    for (int i = 0; i < iterations && calm < 2 && !budget_.spent(); ++i) {
      const Normal normal = normal_equations();
      const double before = fit_.squares;
      if (!descend(normal, damping)) return;
      calm = fit_.squares > before * (1 - kConverged) ? calm + 1 : 0;
    }
  }

  double squares_of(const MachineFit& fit) {
    double sum = 0;
    for (std::size_t r = 0; r < data_.records.size(); ++r) {
      if (rows_[r].empty()) continue;
      const MachineRecord& record = data_.records[r];
      std::vector<double> y = record.input;
      run_from(fit, record, r, 0, y);
      spend(record, fit.machine.blocks.size());
      for (const std::size_t t : rows_[r]) sum += (record.output[t] - y[t]) * (record.output[t] - y[t]);
    }
    return sum;
  }

  Normal normal_equations() {
    const auto shared = static_cast<Index>(shared_ ? fit_.free.size() : 0);
    const auto states = static_cast<Index>(states_);
    const Index all = shared + states * static_cast<Index>(data_.records.size());
    Normal normal{MatrixXd::Zero(all, all), VectorXd::Zero(all)};
    for (std::size_t r = 0; r < data_.records.size(); ++r) {
      if (rows_[r].empty()) continue;
      VectorXd residual;
      const MatrixXd columns = sensitivities(r, residual);
      const MatrixXd squares = columns.transpose() * columns;
      const VectorXd gradient = columns.transpose() * residual;
      const Index at = shared + states * static_cast<Index>(r);
      normal.a.topLeftCorner(shared, shared) += squares.topLeftCorner(shared, shared);
      normal.a.block(0, at, shared, states) = squares.topRightCorner(shared, states);
      normal.a.block(at, 0, states, shared) = squares.bottomLeftCorner(states, shared);
      normal.a.block(at, at, states, states) = squares.bottomRightCorner(states, states);
      normal.g.head(shared) += gradient.head(shared);
      normal.g.segment(at, states) = gradient.tail(states);
    }
    return normal;
  }

 private:
  std::size_t count() const {
    std::size_t sum = 0;
    for (const auto& rows : rows_) sum += rows.size();
    return sum;
  }

  void spend(const MachineRecord& record, std::size_t blocks) {
    budget_.block_samples -= static_cast<double>(record.input.size() * blocks);
  }

  /// d y / d parameter at the rows: shared parameters, then the record's start.
  MatrixXd sensitivities(std::size_t r, VectorXd& residual) {
    const MachineRecord& record = data_.records[r];
    const auto& rows = rows_[r];
    const Chain chain = run_chain(fit_, record, r);
    residual.resize(static_cast<Index>(rows.size()));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      residual[static_cast<Index>(i)] = record.output[rows[i]] - chain.back()[rows[i]];
    }
    const std::size_t shared = shared_ ? fit_.free.size() : 0;
    MatrixXd columns(static_cast<Index>(rows.size()), static_cast<Index>(shared + states_));
    const auto put = [&](std::size_t column, const std::vector<double>& moved, double distance) {
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const double slope = (moved[rows[i]] - chain.back()[rows[i]]) / distance;
        columns(static_cast<Index>(i), static_cast<Index>(column)) = std::isfinite(slope) ? slope : 0;
      }
    };
    if (shared_) shared_columns(r, chain, put);
    start_columns(r, chain, shared, put);
    return columns;
  }

  template <typename Put>
  void shared_columns(std::size_t r, const Chain& chain, const Put& put) {
    const MachineRecord& record = data_.records[r];
    std::size_t basis_block = std::numeric_limits<std::size_t>::max();
    MatrixXd basis;
    for (std::size_t c = 0; c < fit_.free.size(); ++c) {
      const FreeParameter& p = fit_.free[c];
      const MachineBlock& block = fit_.machine.blocks[p.block];
      double distance = 0;
      const double value = value_of(fit_.machine, p);
      const double moved_value = probe(fit_.machine, p, distance);
      std::vector<double> signal;
      if (p.field == MachineField::kNumerator && block.law == MachineLaw::kLinear) {
        if (basis_block != p.block) {
          basis = linear_basis(block, start_of(fit_, r, p.block), chain[p.block]);
          basis_block = p.block;
          spend(record, 1);
        }
        signal = chain[p.block + 1];
        const auto column = basis.col(static_cast<Index>(p.index));
        for (std::size_t t = 0; t < signal.size(); ++t) signal[t] += distance * column[static_cast<Index>(t)];
        run_from(fit_, record, r, p.block + 1, signal);
        spend(record, fit_.machine.blocks.size() - p.block - 1);
      } else {
        signal = chain[p.block];
        set_value(fit_.machine, p, moved_value);
        run_from(fit_, record, r, p.block, signal);
        set_value(fit_.machine, p, value);
        spend(record, fit_.machine.blocks.size() - p.block);
      }
      put(c, signal, distance);
    }
  }

  template <typename Put>
  void start_columns(std::size_t r, const Chain& chain, std::size_t first, const Put& put) {
    const MachineRecord& record = data_.records[r];
    std::size_t at = 0;
    for (std::size_t b = 0; b < fit_.machine.blocks.size(); ++b) {
      const std::size_t size = start_size(fit_.machine.blocks[b]);
      for (std::size_t i = 0; i < size; ++i, ++at) {
        double& start = fit_.starts[r][at];
        const double before = start, step = kRelativeStep * units_[first + at];
        start += step;
        std::vector<double> signal = chain[b];
        run_from(fit_, record, r, b, signal);
        start = before;
        spend(record, fit_.machine.blocks.size() - b);
        put(first + at, signal, step);
      }
    }
  }

  /// One damped step that lowers the cost; false where none does.
  bool descend(const Normal& normal, double& damping) {
    if (normal.g.size() == 0) return false;  // a machine without states has no start to refine
    const VectorXd diagonal = normal.a.diagonal();
    const Eigen::Map<const VectorXd> units(units_.data(), diagonal.size());
    const VectorXd of_units = diagonal.cwiseProduct(units.cwiseAbs2());
    const double floor = 1e-12 * std::max(of_units.maxCoeff(), 1e-300);
    VectorXd scale(diagonal.size());
    for (Index i = 0; i < scale.size(); ++i) scale[i] = of_units[i] > floor ? 1 / std::sqrt(diagonal[i]) : 0;
    const MatrixXd scaled = scale.asDiagonal() * normal.a * scale.asDiagonal();
    const VectorXd gradient = scale.cwiseProduct(normal.g);
    const double variance = fit_.squares / static_cast<double>(std::max<std::size_t>(fit_.rows, 1));
    const double cost = fit_.squares + slow_mode_cost(fit_.machine, limits_, variance);
    while (damping < kMostDamping && !budget_.spent()) {
      MatrixXd damped = scaled;
      damped.diagonal().array() += damping + 1e-14;
      const VectorXd step = scale.cwiseProduct(solve_symmetric(damped, gradient));
      MachineFit trial = fit_;
      move(trial, step);
      trial.squares = squares_of(trial);
      const double trial_cost = trial.squares + slow_mode_cost(trial.machine, limits_, variance);
      if (step.allFinite() && std::isfinite(trial.squares) && trial_cost < cost) {
        fit_ = std::move(trial);
        damping = std::max(damping / 5, 1e-9);
        return true;
      }
      damping *= damping < 1 ? 8 : 20;
    }
    return false;
  }

  void move(MachineFit& fit, const VectorXd& step) const {
    Index at = 0;
    if (shared_) {
      for (const FreeParameter& p : fit.free) {
        set_value(fit.machine, p, restored(p, transformed(p, value_of(fit.machine, p)) + step[at++]));
      }
      keep_stable(fit.machine, limits_);
    }
    for (auto& start : fit.starts) {
      for (double& value : start) value += step[at++];
    }
  }

  const MachineData& data_;
  const MachineRows& rows_;
  MachineFit& fit_;
  MachineBudget& budget_;
  SectionLimits limits_;
  bool shared_;
  std::size_t states_ = 0;
  std::vector<double> units_;  ///< of the free parameters, then of each record's start
};

/// How much longer than white a residual's memory makes the variance of a mean: 1 + 2 Σ ρ_k, up to the first ρ below
/// a tenth.
double memory_factor(std::span<const double> residual) {
  if (residual.empty()) return 1;
  const std::vector<double> products = autocovariance(residual);
  double factor = 1;
  for (std::size_t lag = 1; lag < products.size() / 10; ++lag) {
    const double rho = products[lag] / products[0];
    if (!(rho > 0.1)) break;
    factor += 2 * rho;
  }
  return factor;
}

}  // namespace

double MachineFit::rms() const {
  return failed ? INFINITY : std::sqrt(squares / static_cast<double>(std::max<std::size_t>(rows, 1)));
}

std::vector<FreeParameter> free_dynamics(const MachineBlock& block, std::size_t index) {
  std::vector<FreeParameter> free;
  for (std::size_t s = 0; s < block.sections.size(); ++s) {
    if (block.sections[s].order == 2) free.push_back({index, MachineField::kSectionE, s, true, 1e-12, 2});
    free.push_back({index, MachineField::kSectionF, s, true, 1e-14, 4});
  }
  for (std::size_t i = 0; i < block.numerator.size(); ++i) free.push_back({index, MachineField::kNumerator, i});
  for (std::size_t i = 0; i < block.feedback.size(); ++i) free.push_back({index, MachineField::kFeedback, i});
  return free;
}

std::vector<double> seen_at_rest(const MachineData& data, const std::vector<Section>& sections, std::size_t weights) {
  const double slow_rate = data.records.empty() ? 0 : SectionLimits(longest(data)).slow_rate;
  // Weights run from the last section to the first; what enters a section has passed those before it.
  std::vector<double> factors;
  std::size_t seen = 0;
  while (seen < sections.size() && slowest_rate(sections[seen]) >= slow_rate) ++seen;
  for (std::size_t s = sections.size(); s-- > 0;) {
    factors.push_back(s < seen ? 1 : 0);
    if (sections[s].order == 2) factors.push_back(s == seen ? slowest_rate(sections[s]) : 0);
  }
  factors.push_back(1);
  factors.resize(weights, 0.0);
  return factors;
}

double gain_seen(const MachineData& data, const std::vector<Section>& sections, const std::vector<double>& weights) {
  const std::vector<double> factors = seen_at_rest(data, sections, weights.size());
  return std::inner_product(weights.begin(), weights.end(), factors.begin(), 0.0);
}

double value_of(const Machine& machine, const FreeParameter& p) {
  const MachineBlock& block = machine.blocks[p.block];
  switch (p.field) {
    case MachineField::kParameter:
      return block.parameters[p.index];
    case MachineField::kSectionE:
      return block.sections[p.index].e;
    case MachineField::kSectionF:
      return block.sections[p.index].f;
    case MachineField::kNumerator:
      return block.numerator[p.index];
    case MachineField::kFeedback:
      return block.feedback[p.index];
  }
  return 0;
}

void set_value(Machine& machine, const FreeParameter& p, double value) {
  MachineBlock& block = machine.blocks[p.block];
  switch (p.field) {
    case MachineField::kParameter:
      block.parameters[p.index] = value;
      return;
    case MachineField::kSectionE:
      block.sections[p.index].e = value;
      return;
    case MachineField::kSectionF:
      block.sections[p.index].f = value;
      return;
    case MachineField::kNumerator:
      block.numerator[p.index] = value;
      return;
    case MachineField::kFeedback:
      block.feedback[p.index] = value;
      return;
  }
}

void refine_machine(const MachineData& data, const MachineRows& rows, int iterations, MachineFit& fit,
                    MachineBudget& budget) {
  Refiner(data, rows, fit, budget, true).run(iterations);
}

void evaluate_machine(const MachineData& data, const MachineRows& rows, MachineFit& fit, MachineBudget& budget) {
  Refiner(data, rows, fit, budget, true).run(0);
}

void refine_starts(const MachineData& data, const MachineRows& rows, int iterations, MachineFit& fit,
                   MachineBudget& budget) {
  Refiner(data, rows, fit, budget, false).run(iterations);
}

MatrixXd parameter_covariance(const MachineData& data, const MachineRows& rows, const MachineFit& fit) {
  MachineFit copy = fit;
  MachineBudget budget{.block_samples = 1e12};
  Refiner refiner(data, rows, copy, budget, true);
  const Normal normal = refiner.normal_equations();
  const std::vector<double> residual = residuals_at(data, rows, fit);
  double squares = 0;
  for (const double e : residual) squares += e * e;
  const double variance =
      squares / static_cast<double>(std::max<std::size_t>(residual.size(), 1)) * memory_factor(residual);
  const VectorXd diagonal = normal.a.diagonal().cwiseMax(1e-300);
  const VectorXd scale = diagonal.cwiseSqrt().cwiseInverse();
  MatrixXd scaled = scale.asDiagonal() * normal.a * scale.asDiagonal();
  scaled.diagonal().array() += 1e-12;
  const MatrixXd inverse = inverse_of_symmetric(scaled);
  VectorXd unit(static_cast<Index>(fit.free.size()));
  for (Index i = 0; i < unit.size(); ++i) {
    const FreeParameter& p = fit.free[static_cast<std::size_t>(i)];
    unit[i] = scale[i] * (p.logarithmic ? value_of(fit.machine, p) : 1);
  }
  return variance * unit.asDiagonal() * inverse.topLeftCorner(unit.size(), unit.size()) * unit.asDiagonal();
}

std::vector<double> residuals_at(const MachineData& data, const MachineRows& rows, const MachineFit& fit) {
  std::vector<double> residuals;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const auto y = run_record(data, r, fit);
    for (const std::size_t t : rows[r]) residuals.push_back(data.records[r].output[t] - y[t]);
  }
  return residuals;
}

std::vector<double> run_record(const MachineData& data, std::size_t record, const MachineFit& fit) {
  const MachineRecord& from = data.records[record];
  return run_machine(fit.machine, around(from), fit.starts[record], from.input);
}

}  // namespace valvetriage
