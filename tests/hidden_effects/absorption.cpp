#include "tests/hidden_effects/absorption.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace valvetriage::hidden_effects {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using stand::Unit;

constexpr int kPasts = 3;
constexpr double kHoldPsi = 10;           // what a stuck spool may be off before the first move
constexpr double kSensitivityStep = 0.5;  // of a population standard deviation

/// 1 until the command first moves, then gone with the time constant of the volume.
VectorXd before_the_first_move(const stand::Command& command) {
  constexpr double kVolumeS = 0.065;
  const std::vector<double>& value = command.value_a;
  const auto moved = std::find_if(value.begin(), value.end(), [&](double a) { return a != value.front(); });
  const auto held = static_cast<Index>(moved - value.begin());
  VectorXd column(static_cast<Index>(value.size()));
  for (Index k = 0; k < column.size(); ++k)
    column[k] = k < held ? 1 : std::exp(-command.period_s * static_cast<double>(k - held) / kVolumeS);
  return column;
}

}  // namespace

std::vector<stand::Faults> healthy(const TwinBench& bench) {
  return std::vector<stand::Faults>(bench.recordings());
}

Unit moved(const Unit& unit, const VectorXd& z) {
  Unit result = unit;
  const auto& spread = stand::unit_spread();
  for (std::size_t j = 0; j < spread.size(); ++j) {
    double& value = spread[j].of(result);
    const double step = spread[j].sd * z[static_cast<Index>(j)];
    value = spread[j].relative ? value * std::max(0.05, 1 + step) : value + step;
  }
  return result;
}

Index Absorption::parameters() const {
  return static_cast<Index>(stand::unit_spread().size());
}

VectorXd Absorption::stacked(const VectorXd& error_psi, const VectorXd& theta) const {
  VectorXd rho(error_psi.size() + theta.size());
  rho << error_psi / kNoisePsi, -theta;
  return rho;
}

VectorXd Absorption::stacked(const VectorXd& column_psi) const {
  return stacked(column_psi, VectorXd::Zero(columns.cols()));
}

VectorXd Absorption::off_baseline(const VectorXd& rho) const {
  return rho - basis * (basis.transpose() * rho);
}

Absorption::Absorption(const TwinBench& bench) {
  const auto recordings = static_cast<Index>(bench.recordings());
  const VectorXd output = bench.output(bench.unit(), healthy(bench));
  columns = MatrixXd::Zero(bench.samples(), parameters() + (kPasts + 1) * recordings);
  for (Index j = 0; j < parameters(); ++j) {
    const VectorXd step = kSensitivityStep * VectorXd::Unit(parameters(), j);
    columns.col(j) = (bench.output(moved(bench.unit(), step), healthy(bench)) - output) / kSensitivityStep;
  }
  const auto part = [&](Index kind, std::size_t i) {
    const Index column = parameters() + kind * recordings + static_cast<Index>(i);
    return columns.col(column).segment(bench.begin(i), bench.size(i));
  };
  for (int past = 0; past < kPasts; ++past) {
    const VectorXd difference = (bench.output_after(past) - output) / std::sqrt(static_cast<double>(kPasts));
    for (std::size_t i = 0; i < bench.recordings(); ++i)
      part(past, i) = difference.segment(bench.begin(i), bench.size(i));
  }
  for (std::size_t i = 0; i < bench.recordings(); ++i)
    part(kPasts, i) = kHoldPsi * before_the_first_move(bench.commands()[i]);
  MatrixXd stack(columns.rows() + columns.cols(), columns.cols());
  stack << columns / kNoisePsi, MatrixXd::Identity(columns.cols(), columns.cols());
  const Eigen::HouseholderQR<MatrixXd> qr(stack);
  basis = qr.householderQ() * MatrixXd::Identity(stack.rows(), stack.cols());
  triangle = qr.matrixQR().topRows(stack.cols()).triangularView<Eigen::Upper>();
}

}  // namespace valvetriage::hidden_effects
