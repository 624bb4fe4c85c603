#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "core/discrepancy/black_box.h"
#include "core/discrepancy/machine_search.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMostPlays = 3;
constexpr std::size_t kMostStates = 9;
constexpr std::size_t kMostRows = 4000;

/// A signal so many samples later; its first value until then.
std::vector<double> later(const std::vector<double>& x, int samples) {
  std::vector<double> shifted(x.size());
  for (std::size_t t = 0; t < x.size(); ++t) {
    shifted[t] = x[t > static_cast<std::size_t>(samples) ? t - static_cast<std::size_t>(samples) : 0];
  }
  return shifted;
}

/// States that remember the input: the linear machine's, those of lags a factor three slower and faster, plays. What a
/// controller sets by this very output is no input yet: it would tell the output by the controller run backwards.
MatrixXd states_of(const MachineRecord& record, const MachineGround& ground, double period_s) {
  const MachineBlock& own = ground.of_order(ground.chosen_order).fit.machine.blocks[0];
  const std::vector<double> input = later(record.input, ground.least_delay);
  std::vector<VectorXd> columns;
  MachineBlock block = own;
  block.law = MachineLaw::kLinear;
  block.delay_samples = std::max(0, own.delay_samples - ground.least_delay);
  block.numerator.assign(static_cast<std::size_t>(order_of(block.sections)) + 1, 0.0);
  const MatrixXd basis = linear_basis(block, {}, input);
  for (Index c = 0; c < basis.cols(); ++c) columns.push_back(basis.col(c));
  double slowest = 1;
  for (const Section& section : block.sections) slowest = std::min(slowest, slowest_rate(section));
  for (const double factor : {0.3, 3.0}) {
    MachineBlock lag;
    lag.sections = {{.order = 1, .f = std::clamp(slowest * factor, 1e-6, 0.99)}};
    lag.numerator = {1};
    columns.push_back(linear_basis(lag, {}, input).col(0));
  }
  const MachineSurroundings nothing;
  for (std::size_t i = 0; i < kMostPlays; ++i) {
    MachineBlock play;
    play.law = MachineLaw::kPlay;
    play.parameters = {ground.input_range() * 0.05 * std::pow(3.0, static_cast<double>(i))};
    std::vector<double> held(input.size());
    run_block(
        play, period_s, nothing, {},
        basis.cols() > 1 ? std::span<const double>(columns[0].data(), held.size()) : std::span<const double>(input),
        held);
    columns.push_back(Eigen::Map<VectorXd>(held.data(), static_cast<Index>(held.size())));
  }
  const std::size_t count = std::min(columns.size(), kMostStates);
  MatrixXd states(static_cast<Index>(input.size()), static_cast<Index>(count));
  for (std::size_t c = 0; c < count; ++c) states.col(static_cast<Index>(c)) = columns[c];
  return states;
}

std::vector<std::size_t> thinned(const std::vector<std::size_t>& rows, std::size_t step) {
  std::vector<std::size_t> kept;
  for (std::size_t i = 0; i < rows.size(); i += step) kept.push_back(rows[i]);
  return kept;
}

}  // namespace

std::vector<double> black_box_log_rms(const MachineData& data, const MachineGround& ground) {
  std::vector<MatrixXd> terms;
  std::vector<VectorXd> residual;  // of the linear machine: the black box has to explain what that leaves
  const MachineFit& linear = ground.of_order(ground.chosen_order).fit;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    terms.push_back(polynomials(states_of(data.records[r], ground, data.period_s)));
    const auto y = run_record(data, r, linear);
    VectorXd gap(static_cast<Index>(y.size()));
    for (std::size_t t = 0; t < y.size(); ++t) gap[static_cast<Index>(t)] = data.records[r].output[t] - y[t];
    residual.push_back(std::move(gap));
  }
  const Index width = terms.front().cols();
  const std::size_t step = std::max<std::size_t>(1, data.samples() / kMostRows);
  std::vector<double> best;
  double best_mean = INFINITY;
  for (const double strength : {1e-7, 1e-4, 1e-2}) {
    std::vector<double> log_rms;
    for (const MachineFold& fold : data.folds) {
      MatrixXd square = MatrixXd::Zero(width, width);
      VectorXd right = VectorXd::Zero(width);
      for (std::size_t r = 0; r < fold.fit.size(); ++r) {
        const auto rows = thinned(fold.fit[r], step);
        if (rows.empty()) continue;
        const MatrixXd part = terms[r](rows, Eigen::all);
        square += part.transpose() * part;
        right += part.transpose() * residual[r](rows);
      }
      const VectorXd weights = ridge(square, right, strength);
      for (const auto& group : fold.judged) {
        double squares = 0;
        for (const std::size_t t : group.rows) {
          const auto i = static_cast<Index>(t);
          squares += std::pow(residual[group.record][i] - terms[group.record].row(i).dot(weights), 2);
        }
        log_rms.push_back(0.5 * std::log(squares / static_cast<double>(group.rows.size()) + 1e-18));
      }
    }
    double mean = 0;
    for (const double value : log_rms) mean += value / static_cast<double>(log_rms.size());
    if (mean < best_mean) {
      best_mean = mean;
      best = std::move(log_rms);
    }
  }
  return best;
}

}  // namespace valvetriage
