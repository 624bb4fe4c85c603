#include "core/discrepancy/machine_leftover.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kShifts = 199;
constexpr std::size_t kBlocks = 12;  // over all records
constexpr double kDependent = 1e-9;  // a state that the others tell

/// What one record's residual is regressed on, and where it is cut.
struct Regression {
  VectorXd residual;
  std::vector<Index> cuts;      ///< blocks begin here; the last is the end
  std::vector<MatrixXd> bases;  ///< orthonormal, per block
};

/// States, input and a level.
MatrixXd states_of(const MachineRecord& record, const MachineFit& linear) {
  MachineBlock block = linear.machine.blocks[0];
  block.numerator.assign(static_cast<std::size_t>(order_of(block.sections)) + 1, 0.0);
  const MatrixXd basis = linear_basis(block, {}, record.input);
  MatrixXd states(basis.rows(), basis.cols() + 1);
  states << basis, VectorXd::Ones(basis.rows());
  return states;
}

Regression regression_of(const MachineData& data, std::size_t r, const MachineFit& linear, std::size_t blocks) {
  const MachineRecord& record = data.records[r];
  const auto n = static_cast<Index>(record.input.size());
  const MatrixXd states = states_of(record, linear);
  Regression regression{.residual = VectorXd::Zero(n)};
  const auto run = run_record(data, r, linear);
  for (const std::size_t t : record.valid) regression.residual[static_cast<Index>(t)] = record.output[t] - run[t];
  // What holds over the whole record is the linear machine's own, a numerator that could be better.
  const MatrixXd over_all = orthonormal_basis(states, kDependent);
  regression.residual -= over_all * (over_all.transpose() * regression.residual).eval();
  for (std::size_t b = 0; b <= blocks; ++b) {
    regression.cuts.push_back(n * static_cast<Index>(b) / static_cast<Index>(blocks));
    if (b == 0) continue;
    const Index begin = regression.cuts[b - 1];
    regression.bases.push_back(orthonormal_basis(states.middleRows(begin, regression.cuts[b] - begin), kDependent));
  }
  return regression;
}

/// Share of the residual, moved on by a part of each record, that the blocks' regressions take up.
double share_of(const std::vector<Regression>& regressions, double part) {
  double explained = 0, power = 0;
  for (const Regression& regression : regressions) {
    const Index n = regression.residual.size();
    const auto shift = static_cast<Index>(part * static_cast<double>(n));
    VectorXd moved(n);
    moved << regression.residual.tail(n - shift), regression.residual.head(shift);
    for (std::size_t b = 0; b < regression.bases.size(); ++b) {
      const Index begin = regression.cuts[b];
      const auto block = moved.segment(begin, regression.cuts[b + 1] - begin);
      explained += (regression.bases[b].transpose() * block).squaredNorm();
      power += block.squaredNorm();
    }
  }
  return power > 0 ? explained / power : 0;
}

}  // namespace

LocalAnswer local_answer(const MachineData& data, const MachineFit& linear) {
  if (data.records.empty() || linear.machine.blocks.empty()) return {};
  const std::size_t blocks = std::max<std::size_t>(2, kBlocks / data.records.size());
  std::vector<Regression> regressions;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    regressions.push_back(regression_of(data, r, linear, blocks));
  }
  const double share = share_of(regressions, 0);
  if (!std::isfinite(share)) return {};
  std::vector<double> by_chance;
  std::size_t as_much = 0;
  for (std::size_t k = 1; k <= kShifts; ++k) {
    by_chance.push_back(share_of(regressions, static_cast<double>(k) / static_cast<double>(kShifts + 1)));
    as_much += by_chance.back() >= share ? 1 : 0;
  }
  std::nth_element(by_chance.begin(), by_chance.begin() + kShifts / 2, by_chance.end());
  return {share - by_chance[kShifts / 2], static_cast<double>(1 + as_much) / static_cast<double>(kShifts + 1)};
}

}  // namespace valvetriage
