#include "core/discrepancy/machine_shape.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "core/discrepancy/machine_chance.h"
#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kLeastShare = 0.005;  // of the samples: what is seen at fewer is chance

/// The signal that enters a block, at the valid samples of all records.
std::vector<double> entering(const MachineData& data, const MachineFit& fit, std::size_t block) {
  std::vector<double> values;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    Machine before = fit.machine;
    before.blocks.resize(block);
    const auto signal = run_machine(before, around(record), fit.starts[r], record.input);
    for (const std::size_t t : record.valid) values.push_back(signal[t]);
  }
  return values;
}

bool is_shape(MachineLaw law) {
  switch (law) {
    case MachineLaw::kDeadBand:
    case MachineLaw::kUpperLimit:
    case MachineLaw::kLowerLimit:
    case MachineLaw::kCurve:
    case MachineLaw::kMagnitude:
      return true;
    default:
      return false;
  }
}

/// A hat over its node, one at it and nothing at its neighbours: what a map of straight pieces is made of.
double hat(const std::vector<double>& nodes, std::size_t node, double x) {
  if (node > 0 && x < nodes[node]) return std::max(0.0, 1 - (nodes[node] - x) / (nodes[node] - nodes[node - 1]));
  if (node + 1 < nodes.size() && x > nodes[node]) {
    return std::max(0.0, 1 - (x - nodes[node]) / (nodes[node + 1] - nodes[node]));
  }
  return 1;
}

/// How the output moves with a hat of what enters block `shape` added to what leaves it.
std::vector<double> moved_by_hat(const MachineData& data, const MachineFit& fit, std::size_t shape,
                                 const std::vector<double>& nodes, std::size_t node) {
  constexpr double kStep = 1e-5;
  const Machine& machine = fit.machine;
  std::vector<double> moves;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    std::vector<double> signal(record.input.begin(), record.input.end()), added;
    std::size_t at = 0;
    for (std::size_t b = 0; b < machine.blocks.size(); ++b) {
      const std::size_t size = start_size(machine.blocks[b]);
      const auto start = std::span(fit.starts[r]).subspan(at, size);
      const std::vector<double> before = signal;
      run_block(machine.blocks[b], machine.sample_period_s, around(record), start, signal, signal);
      if (!added.empty()) {
        run_block(machine.blocks[b], machine.sample_period_s, around(record), start, added, added);
      }
      if (b == shape) {
        added = signal;
        for (std::size_t t = 0; t < added.size(); ++t) added[t] += kStep * hat(nodes, node, before[t]);
      }
      at += size;
    }
    for (const std::size_t t : record.valid) moves.push_back((added[t] - signal[t]) / kStep);
  }
  return moves;
}

}  // namespace

bool is_reached(const MachineData& data, const MachineFit& fit, std::size_t limit) {
  const MachineBlock& block = fit.machine.blocks[limit];
  const double level = block.parameters[0];
  const std::vector<double> signal = entering(data, fit, limit);
  const auto beyond = std::count_if(signal.begin(), signal.end(), [&](double x) {
    return block.law == MachineLaw::kUpperLimit ? x > level : x < level;
  });
  return beyond >= 3 && static_cast<double>(beyond) >= kLeastShare * static_cast<double>(signal.size());
}

bool is_at_far_end(const MachineData& data, const MachineFit& fit, std::size_t band, double input_zero) {
  constexpr double kSeldom = 0.05;  // of the samples
  constexpr double kAsFar = 0.1;    // of the input's range: ends about as far from its zero are both far
  const MachineBlock& block = fit.machine.blocks[band];
  const double centre = block.parameters[0], half = 0.5 * block.parameters[1];
  const std::vector<double> signal = entering(data, fit, band);
  const auto often = [&](auto count) {
    return static_cast<double>(count) >= kSeldom * static_cast<double>(signal.size());
  };
  const bool above = often(std::ranges::count_if(signal, [&](double x) { return x > centre + half; }));
  const bool below = often(std::ranges::count_if(signal, [&](double x) { return x < centre - half; }));
  if (above == below) return false;
  double low = INFINITY, high = -INFINITY;
  for (const MachineRecord& record : data.records) {
    const auto [least, most] = std::ranges::minmax_element(record.input);
    low = std::min(low, *least);
    high = std::max(high, *most);
  }
  const double zero = (input_zero - low) / (high - low);  // 0 at the low end, 1 at the high one
  return above ? zero > 0.5 - kAsFar : zero < 0.5 + kAsFar;
}

bool has_true_stops(const MachineData& data, const MachineFit& fit) {
  constexpr double kStep = 1e-4, kStands = 0.1;
  for (std::size_t b = 0; b < fit.machine.blocks.size(); ++b) {
    const MachineBlock& block = fit.machine.blocks[b];
    if (block.law != MachineLaw::kUpperLimit && block.law != MachineLaw::kLowerLimit) continue;
    if (!is_reached(data, fit, b)) continue;
    if (b > 0 && block.law == MachineLaw::kLowerLimit && fit.machine.blocks[b - 1].law == MachineLaw::kUpperLimit) {
      const auto& upper = fit.machine.blocks[b - 1].parameters;
      if (upper[0] - block.parameters[0] < upper[1] + block.parameters[1]) return false;
    }
    const std::vector<double> signal = entering(data, fit, b);
    std::vector<double> at = signal, above = signal;
    for (double& x : above) x += kStep;
    run_block(block, fit.machine.sample_period_s, {}, {}, at, at);
    run_block(block, fit.machine.sample_period_s, {}, {}, above, above);
    std::size_t stands = 0;
    for (std::size_t i = 0; i < at.size(); ++i) stands += above[i] - at[i] < kStands * kStep ? 1 : 0;
    if (static_cast<double>(stands) < kLeastShare * static_cast<double>(at.size())) return false;
  }
  return true;
}

double share_driven(const MachineData& data, const MachineFit& fit) {
  double driven = 0, power = 0;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    const std::vector<double> still(record.input.size(), record.input.front());
    const auto moved = run_record(data, r, fit);
    const auto rests = run_machine(fit.machine, around(record), fit.starts[r], still);
    double mean = 0;
    for (const std::size_t t : record.valid) mean += record.output[t] / static_cast<double>(record.valid.size());
    for (const std::size_t t : record.valid) {
      driven += std::pow(moved[t] - rests[t], 2);
      power += std::pow(record.output[t] - mean, 2);
    }
  }
  return power > 0 ? driven / power : 0;
}

LeftAnswer answer_by_shape(const MachineData& data, const MachineFit& fit) {
  constexpr std::size_t kNodes = 9;
  constexpr double kDependent = 1e-6;
  const std::vector<double> left = residuals_at(data, data.all_rows(), fit);
  const Eigen::Map<const VectorXd> residual(left.data(), static_cast<Index>(left.size()));
  const double power = residual.squaredNorm();
  LeftAnswer most;
  for (std::size_t b = 0; b < fit.machine.blocks.size() && power > 0; ++b) {
    if (!is_shape(fit.machine.blocks[b].law)) continue;
    const std::vector<double> signal = entering(data, fit, b);
    const auto [low, high] = std::minmax_element(signal.begin(), signal.end());
    if (!(*high > *low)) continue;
    std::vector<double> nodes;
    for (std::size_t k = 0; k < kNodes; ++k) {
      nodes.push_back(*low + (*high - *low) * static_cast<double>(k) / static_cast<double>(kNodes - 1));
    }
    MatrixXd columns(residual.size(), static_cast<Index>(kNodes));
    for (std::size_t k = 0; k < kNodes; ++k) {
      const std::vector<double> moves = moved_by_hat(data, fit, b, nodes, k);
      columns.col(static_cast<Index>(k)) = Eigen::Map<const VectorXd>(moves.data(), residual.size());
    }
    const MatrixXd basis = orthonormal_basis(columns, kDependent);
    const LeftAnswer answer = beyond_chance([&](double part) {
      VectorXd moved(residual.size());
      Index at = 0;
      for (const MachineRecord& record : data.records) {
        const auto n = static_cast<Index>(record.valid.size());
        moved.segment(at, n) = shifted(residual.segment(at, n), part);
        at += n;
      }
      return (basis.transpose() * moved).squaredNorm() / power;
    });
    if (answer.share > most.share) most = answer;
  }
  return most;
}

}  // namespace valvetriage
