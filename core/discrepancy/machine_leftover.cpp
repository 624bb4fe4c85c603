#include "core/discrepancy/machine_leftover.h"

#include <Eigen/Core>
#include <algorithm>
#include <boost/math/statistics/univariate_statistics.hpp>
#include <cmath>

#include "core/discrepancy/machine_chance.h"
#include "core/identify/coloured_noise.h"
#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMostRows = 40'000;
constexpr std::size_t kCurveLags = 4;  // of 2, 8, 32 and 128 samples
constexpr double kDependent = 1e-9;    // a state that the others tell

/// Of how many rows each is looked at, so that there are not too many.
std::size_t stride_of(const MachineData& data) {
  return (data.samples() + kMostRows - 1) / kMostRows;
}

MatrixXd every(const MatrixXd& rows, std::size_t stride) {
  const auto step = static_cast<Index>(stride);
  return rows(Eigen::seq(0, rows.rows() - 1, step), Eigen::all);
}

/// What a fit leaves of one record, none where a sample is not valid; less the line from its beginning to its end, so
/// that moved along the record it does not jump where the end meets the beginning.
VectorXd residual_of(const MachineData& data, std::size_t r, const std::vector<double>& run) {
  constexpr Index kEnds = 50;  // of the record is averaged at either end: one part
  const MachineRecord& record = data.records[r];
  const auto n = static_cast<Index>(record.input.size());
  VectorXd residual = VectorXd::Zero(n);
  for (const std::size_t t : record.valid) residual[static_cast<Index>(t)] = record.output[t] - run[t];
  const Index ends = std::max<Index>(n / kEnds, 1);
  const double from = residual.head(ends).mean(), to = residual.tail(ends).mean();
  return residual - VectorXd::LinSpaced(n, from, to);
}

/// What is left of columns beside an orthonormal basis.
MatrixXd without(const MatrixXd& basis, MatrixXd columns) {
  columns -= (basis * (basis.transpose() * columns)).eval();
  return columns;
}

/// What one record's residual is regressed on, and where it is cut.
struct Regression {
  VectorXd residual;
  MatrixXd own;                 ///< orthonormal: what the linear machine takes up over the whole record
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

VectorXd lagged(const VectorXd& x, double samples) {
  const double keep = std::exp(-1 / samples);
  VectorXd y(x.size());
  double state = x.size() > 0 ? x[0] : 0;
  for (Index t = 0; t < x.size(); ++t) y[t] = state = x[t] + keep * (state - x[t]);
  return y;
}

/// Lags [samples] that every record has room for: a longer one is a drift.
std::vector<double> lags_of(const MachineData& data) {
  constexpr std::size_t kLagsInRecord = 8;
  std::size_t shortest = SIZE_MAX;
  for (const MachineRecord& record : data.records) shortest = std::min(shortest, record.input.size());
  std::vector<double> lags;
  for (double samples = 1; samples * kLagsInRecord <= static_cast<double>(shortest); samples *= 2)
    lags.push_back(samples);
  return lags;
}

/// What any linear machine would take up: the states of this one, and the input behind lags of every length. Poles that
/// could be better are no answer beyond a linear machine's.
MatrixXd linear_of(const MachineRecord& record, const MachineFit& linear, const std::vector<double>& lags) {
  const MatrixXd states = states_of(record, linear);
  const Eigen::Map<const VectorXd> input(record.input.data(), states.rows());
  MatrixXd all(states.rows(), states.cols() + static_cast<Index>(lags.size()));
  all.leftCols(states.cols()) = states;
  for (std::size_t k = 0; k < lags.size(); ++k) all.col(states.cols() + static_cast<Index>(k)) = lagged(input, lags[k]);
  return all;
}

Regression regression_of(const MachineData& data, std::size_t r, const MachineFit& linear,
                         const std::vector<double>& lags, std::size_t blocks) {
  const std::size_t stride = stride_of(data);
  const MatrixXd linear_rows = every(linear_of(data.records[r], linear, lags), stride);
  const auto states = linear_rows.leftCols(linear_rows.cols() - static_cast<Index>(lags.size()));
  Regression regression{.residual = every(residual_of(data, r, run_record(data, r, linear)), stride)};
  regression.own = orthonormal_basis(linear_rows, kDependent);
  const Index n = states.rows();
  for (std::size_t b = 0; b <= blocks; ++b) {
    regression.cuts.push_back(n * static_cast<Index>(b) / static_cast<Index>(blocks));
    if (b == 0) continue;
    const Index begin = regression.cuts[b - 1];
    regression.bases.push_back(orthonormal_basis(states.middleRows(begin, regression.cuts[b] - begin), kDependent));
  }
  return regression;
}

/// Share of the residual, moved on by a part of each record, that the blocks' regressions take up.
double share_of_blocks(const std::vector<Regression>& regressions, double part) {
  double explained = 0, power = 0;
  for (const Regression& regression : regressions) {
    const VectorXd moved = without(regression.own, shifted(regression.residual, part));
    for (std::size_t b = 0; b < regression.bases.size(); ++b) {
      const Index begin = regression.cuts[b];
      const auto block = moved.segment(begin, regression.cuts[b + 1] - begin);
      explained += (regression.bases[b].transpose() * block).squaredNorm();
      power += block.squaredNorm();
    }
  }
  return power > 0 ? explained / power : 0;
}

/// A signal's range over all records, as [-1, 1].
struct Range {
  double low = INFINITY, high = -INFINITY;
  void add(const std::vector<double>& values) {
    for (const double x : values) {
      low = std::min(low, x);
      high = std::max(high, x);
    }
  }
  VectorXd scaled(const std::vector<double>& values) const {
    const Eigen::Map<const VectorXd> x(values.data(), static_cast<Index>(values.size()));
    if (!(high > low)) return VectorXd::Zero(x.size());
    return (2 * (x.array() - low) / (high - low) - 1).matrix();
  }
};

VectorXd played(const VectorXd& x, double width) {
  VectorXd y(x.size());
  double state = x.size() > 0 ? x[0] : 0;
  for (Index t = 0; t < x.size(); ++t) y[t] = state = std::clamp(state, x[t] - width / 2, x[t] + width / 2);
  return y;
}

VectorXd speed_of(const VectorXd& x) {
  VectorXd v = VectorXd::Zero(x.size());
  v.tail(x.size() - 1) = x.tail(x.size() - 1) - x.head(x.size() - 1);
  return v;
}

/// Chebyshev polynomials of degree 2 to 4 of what lies in [-1, 1].
void add_curves(const VectorXd& q, std::vector<VectorXd>& columns) {
  const auto x = q.array();
  columns.push_back((2 * x.square() - 1).matrix());
  columns.push_back((4 * x.cube() - 3 * x).matrix());
  columns.push_back((8 * x.square().square() - 8 * x.square() + 1).matrix());
}

/// Curves, plays and speeds of one record's input and simulated output, those of the input behind lags, too.
MatrixXd curves_of(const VectorXd& input, const VectorXd& simulated, const std::vector<double>& lags) {
  std::vector<VectorXd> now;
  add_curves(input, now);
  for (const double width : {0.2, 0.6}) now.push_back(played(input, width));
  now.push_back(speed_of(input).cwiseAbs());
  std::vector<VectorXd> columns = now;
  for (const double samples : lags) {
    for (const VectorXd& column : now) columns.push_back(lagged(column, samples));
  }
  const VectorXd speed = speed_of(simulated);
  add_curves(simulated, columns);
  columns.push_back(speed.cwiseAbs());
  columns.push_back(speed.cwiseProduct(speed.cwiseAbs()));
  columns.push_back(speed.cwiseProduct(simulated));
  columns.push_back(input.cwiseProduct(simulated));
  MatrixXd all(input.size(), static_cast<Index>(columns.size()));
  for (std::size_t c = 0; c < columns.size(); ++c) all.col(static_cast<Index>(c)) = columns[c];
  return all;
}

MatrixXd stacked(const std::vector<MatrixXd>& parts) {
  Index rows = 0;
  for (const MatrixXd& part : parts) rows += part.rows();
  MatrixXd all(rows, parts.front().cols());
  Index at = 0;
  for (const MatrixXd& part : parts) {
    all.middleRows(at, part.rows()) = part;
    at += part.rows();
  }
  return all;
}

/// Orthonormal: the straight lines over so many rows. A record that is moved along would jump by one.
MatrixXd lines_over(Index rows) {
  MatrixXd line(rows, 2);
  line.col(0).setOnes();
  line.col(1) = VectorXd::LinSpaced(rows, -1, 1);
  return orthonormal_basis(line, kDependent);
}

/// Columns through the filter that makes white noise of a residual: from row `order` on.
MatrixXd whitened(const MatrixXd& columns, const std::vector<double>& phi) {
  const auto order = static_cast<Index>(phi.size());
  MatrixXd white = columns.bottomRows(columns.rows() - order);
  for (Index lag = 1; lag <= order; ++lag) {
    white -= phi[static_cast<std::size_t>(lag - 1)] * columns.middleRows(order - lag, white.rows());
  }
  return white;
}

/// Rows, counted from `order` on, whose own sample and `order` before it are valid.
std::vector<Index> whole_rows(const MachineRecord& record, std::size_t order) {
  std::vector<Index> rows;
  for (std::size_t i = order; i < record.valid.size(); ++i) {
    if (record.valid[i] - record.valid[i - order] == order) rows.push_back(static_cast<Index>(record.valid[i] - order));
  }
  return rows;
}

}  // namespace

LeftAnswer local_answer(const MachineData& data, const MachineFit& linear, std::size_t over_all) {
  if (data.records.empty() || linear.machine.blocks.empty()) return {};
  const std::size_t blocks = std::max<std::size_t>(2, over_all / data.records.size());
  const std::vector<double> lags = lags_of(data);
  std::vector<Regression> regressions;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    regressions.push_back(regression_of(data, r, linear, lags, blocks));
  }
  return beyond_chance([&](double part) { return share_of_blocks(regressions, part); });
}

LeftAnswer curved_answer(const MachineData& data, const MachineFit& linear) {
  if (data.records.empty() || linear.machine.blocks.empty()) return {};
  std::vector<std::vector<double>> runs;
  Range inputs, outputs;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    runs.push_back(run_record(data, r, linear));
    inputs.add(data.records[r].input);
    outputs.add(runs[r]);
  }
  const std::vector<double> linear_lags = lags_of(data);
  std::vector<double> lags;
  for (std::size_t k = 1; k < linear_lags.size() && lags.size() < kCurveLags; k += 2) lags.push_back(linear_lags[k]);

  const std::size_t stride = stride_of(data);
  std::vector<MatrixXd> residuals, lines, curves, states;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    residuals.push_back(every(residual_of(data, r, runs[r]), stride));
    lines.push_back(lines_over(residuals[r].rows()));
    const MatrixXd of_record = curves_of(inputs.scaled(record.input), outputs.scaled(runs[r]), lags);
    curves.push_back(without(lines[r], every(of_record, stride)));
    states.push_back(without(lines[r], every(linear_of(record, linear, linear_lags), stride)));
  }
  const MatrixXd own = orthonormal_basis(stacked(states), kDependent);
  const MatrixXd basis = orthonormal_basis(without(own, stacked(curves)), kDependent);
  return beyond_chance([&](double part) {
    std::vector<MatrixXd> records;
    for (std::size_t r = 0; r < residuals.size(); ++r) {
      records.push_back(without(lines[r], shifted(residuals[r], part)));
    }
    const VectorXd moved = without(own, stacked(records));
    const double power = moved.squaredNorm();
    return power > 0 ? (basis.transpose() * moved).squaredNorm() / power : 0;
  });
}

double share_of_bursts(const MachineData& data, const MachineFit& linear) {
  constexpr std::size_t kLargestOrder = 40;
  constexpr Index kFewestRows = 200;
  constexpr double kMedianOfNormal = 0.6745;  // of |z|
  constexpr double kBurst = 6;                // deviations: of normal noise one sample in five hundred million
  if (data.records.empty() || linear.machine.blocks.empty()) return 0;
  std::vector<MatrixXd> residuals;
  std::size_t valid = 0;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    residuals.push_back(residual_of(data, r, run_record(data, r, linear)));
    valid += data.records[r].valid.size();
  }
  const std::vector<double> phi = fit_coloured_noise(stacked(residuals), valid, kLargestOrder).phi;
  const std::vector<double> lags = lags_of(data);
  const std::size_t stride = stride_of(data);
  std::vector<MatrixXd> innovations, taken_up;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    if (record.input.size() <= phi.size()) continue;
    const std::vector<Index> rows = whole_rows(record, phi.size());
    innovations.push_back(every(whitened(residuals[r], phi)(rows, Eigen::all), stride));
    taken_up.push_back(every(whitened(linear_of(record, linear, lags), phi)(rows, Eigen::all), stride));
  }
  if (innovations.empty()) return 0;
  const MatrixXd own = orthonormal_basis(stacked(taken_up), kDependent);
  const VectorXd left = without(own, stacked(innovations));
  if (left.size() < std::max(kFewestRows, 10 * own.cols())) return 0;
  VectorXd size = left.cwiseAbs();
  const double usual = boost::math::statistics::median(size) / kMedianOfNormal;
  const double power = left.squaredNorm();
  return power > 0 ? (left.array().abs() > kBurst * usual).select(left.array().square(), 0).sum() / power : 0;
}

}  // namespace valvetriage
