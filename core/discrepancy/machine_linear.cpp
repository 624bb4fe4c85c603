#include "core/discrepancy/machine_linear.h"

#include <Eigen/Core>
#include <algorithm>

#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

constexpr double kOffset = 1e9;  // an integrating machine stands still at an input of its own, times a long lag

/// What the states leave behind on their own: the last section's level after each of them is moved by one, n × order.
Eigen::MatrixXd free_responses(const MachineBlock& block, std::span<const double> input, const Eigen::MatrixXd& still,
                               const Eigen::VectorXd& weights) {
  const int states = order_of(block.sections);
  Eigen::MatrixXd responses(still.rows(), states);
  for (int j = 0; j < states; ++j) {
    std::vector<double> start(static_cast<std::size_t>(states));
    start[static_cast<std::size_t>(j)] = 1;
    responses.col(j) = (linear_basis(block, start, input) - still) * weights;
  }
  return responses;
}

}  // namespace

LinearMachine linear_machine(std::vector<Section> sections, int dead_samples, double gain, const MachineData& data) {
  const int order = order_of(sections);
  LinearMachine machine{.order = order, .fit = {}};
  MachineBlock block;
  block.sections = std::move(sections);
  block.numerator.assign(static_cast<std::size_t>(order) + 1, 0.0);
  block.numerator[0] = gain;
  block.delay_samples = dead_samples;
  MachineBlock offset;
  offset.law = MachineLaw::kAffine;
  offset.parameters = {1, 0};
  machine.fit.machine = {.sample_period_s = data.period_s, .interval_means = false, .blocks = {block, offset}};
  machine.fit.free = free_dynamics(block, 0);
  machine.fit.free.push_back({1, MachineField::kParameter, 1, false, -kOffset, kOffset});
  return machine;
}

LinearMachine linear_machine(int order, std::span<const std::complex<double>> poles, int dead_samples, double gain,
                             const MachineData& data) {
  std::size_t longest = 2;
  for (const MachineRecord& record : data.records) longest = std::max(longest, record.input.size());
  std::vector<Section> sections;
  if (order > 0) sections = sections_from_poles(poles, SectionLimits(longest));
  return linear_machine(std::move(sections), dead_samples, gain, data);
}

std::optional<LinearMachine> identified_linear(const MachineData& data, int order, int dead_samples) {
  constexpr int kIterations = 15;
  std::vector<Recording> recordings;
  std::vector<const Recording*> pointers;
  for (const MachineRecord& record : data.records) recordings.push_back(as_recording(record, data.period_s));
  for (const Recording& recording : recordings) pointers.push_back(&recording);
  OutputErrorOptions options;
  options.offsets = OffsetSharing::kShared;
  options.max_iterations = kIterations;
  options.max_search_rows = kLinearRows;
  const auto fit = fit_output_error(pointers, {order, order, dead_samples}, options);
  if (!fit) return std::nullopt;
  return linear_machine(order, fit->transfer_function.poles, dead_samples, fit->static_gain, data);
}

bool solve_linear(const MachineData& data, LinearMachine& machine) {
  MachineBlock& block = machine.fit.machine.blocks[0];
  const auto terms = static_cast<Eigen::Index>(block.numerator.size());
  const auto states = static_cast<Eigen::Index>(order_of(block.sections));
  const auto records = static_cast<Eigen::Index>(data.records.size());
  const Eigen::VectorXd last = Eigen::VectorXd::Unit(terms, 0);
  std::vector<Eigen::MatrixXd> bases;
  std::vector<std::pair<std::size_t, std::size_t>> rows;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    bases.push_back(linear_basis(block, {}, record.input));
    const std::size_t step = std::max<std::size_t>(1, data.samples() / kLinearRows);
    for (std::size_t i = 0; i < record.valid.size(); i += step) rows.emplace_back(r, record.valid[i]);
  }
  // The levels of a slow section hardly leave the first input: of one record, what they start from is an offset.
  Eigen::VectorXd rest = Eigen::VectorXd::Zero(terms);
  if (records == 1) rest = bases.front().row(0);
  Eigen::MatrixXd columns = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(rows.size()), terms + 1 + states * records);
  Eigen::VectorXd right(columns.rows());
  std::vector<Eigen::MatrixXd> free;
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    free.push_back(free_responses(block, data.records[r].input, bases[r], last));
  }
  for (Eigen::Index i = 0; i < columns.rows(); ++i) {
    const auto [r, t] = rows[static_cast<std::size_t>(i)];
    const auto at = static_cast<Eigen::Index>(t);
    columns.row(i).head(terms) = bases[r].row(at) - rest.transpose();
    columns(i, terms) = 1;
    columns.row(i).segment(terms + 1 + states * static_cast<Eigen::Index>(r), states) = free[r].row(at);
    right[i] = data.records[r].output[t];
  }
  const Eigen::VectorXd solved = scaled_least_squares(columns, right);
  if (!solved.allFinite()) return false;
  const Eigen::VectorXd numerator = solved.head(terms);
  const double offset = solved[terms] - numerator.dot(rest);
  block.numerator.assign(numerator.begin(), numerator.end());
  machine.fit.machine.blocks[1].parameters[1] = offset;
  machine.fit.squares = (columns * solved - right).squaredNorm();
  machine.fit.rows = rows.size();
  machine.fit.starts.clear();
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    const MachineRecord& record = data.records[r];
    const Eigen::MatrixXd moved = free_responses(block, record.input, bases[r], numerator);
    const Eigen::VectorXd gap = Eigen::Map<const Eigen::VectorXd>(record.output.data(), bases[r].rows()) -
                                bases[r] * numerator - Eigen::VectorXd::Constant(bases[r].rows(), offset);
    const std::vector<Eigen::Index> valid(record.valid.begin(), record.valid.end());
    const Eigen::VectorXd start = scaled_least_squares(moved(valid, Eigen::all), gap(valid));
    machine.fit.starts.emplace_back(start.begin(), start.end());
  }
  return true;
}

}  // namespace valvetriage
