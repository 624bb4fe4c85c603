#include "core/identify/output_error_problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "core/identify/triangular_factor.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Weight of the initial state's own scale: keeps states that died out before they were seen at zero.
constexpr double kLocalRidge = 1e-9;

constexpr std::size_t kSamplesPerParameter = 10;

Index as_index(std::size_t n) {
  return static_cast<Index>(n);
}

std::span<const double> span_of(const VectorXd& v) {
  return {v.data(), static_cast<std::size_t>(v.size())};
}
std::span<double> column(MatrixXd& m, Index j) {
  return {m.col(j).data(), static_cast<std::size_t>(m.rows())};
}

constexpr Index kSettlingPeriod = 128;  // samples between looks at responses that have died out

/// Columns y_m, v_m, y_(m−1), … of a cascade driven by x, in the order of basis_numerators. Sample by sample through
/// all sections: their recursions are independent within a sample and overlap in the processor.
void run_cascade(std::span<const Section> sections, std::span<const double> x, double rest, MatrixXd& columns) {
  std::array<SectionState, kMaxIdentifiedOrder> states;
  std::array<double*, kMaxIdentifiedOrder> levels{};
  std::array<double*, kMaxIdentifiedOrder> differences{};
  std::vector<double> unused(x.size());
  const std::size_t count = sections.size();
  Index next = order_of(sections);
  for (std::size_t s = 0; s < count; ++s) {
    next -= sections[s].order;
    states[s] = SectionState(sections[s], rest);
    levels[s] = columns.col(next).data();
    differences[s] = sections[s].order == 2 ? columns.col(next + 1).data() : unused.data();
  }
  for (std::size_t t = 0; t < x.size(); ++t) {
    double signal = x[t];
    for (std::size_t s = 0; s < count; ++s) {
      levels[s][t] = signal = states[s].step(signal);
      differences[s][t] = states[s].difference;
    }
    if (t % kSettlingPeriod == 0)
      std::for_each(states.begin(), states.end(), [](SectionState& state) { state.settle(); });
  }
}

/// Picks rows of a signal matrix into columns `at` … of a regression matrix.
void gather(const MatrixXd& signals, Index used, std::span<const std::size_t> rows, MatrixXd& into, Index at) {
  for (Index j = 0; j < used; ++j) {
    const double* from = signals.col(j).data();
    double* to = into.col(at + j).data();
    for (const std::size_t row : rows) *to++ = from[row];
  }
}

/// R of [local | others] without the rows that only determine the local parameters; `local_rows` receives those.
MatrixXd eliminate_local(const MatrixXd& regression, Index locals, MatrixXd& local_rows) {
  const Index p = regression.cols();
  MatrixXd R = MatrixXd::Zero(p, p);
  for (Index j = 0; j < locals; ++j) R(j, j) = kLocalRidge * regression.col(j).norm() + 1e-300;
  R = triangular_factor(regression, std::move(R));
  local_rows = R.topRows(locals);
  return R.bottomRightCorner(p - locals, p - locals);
}

VectorXd back_substitute(const MatrixXd& local_rows, Index locals, const VectorXd& others) {
  // The last column is the output.
  const VectorXd rhs = local_rows.col(local_rows.cols() - 1) - local_rows.middleCols(locals, others.size()) * others;
  return local_rows.leftCols(locals).triangularView<Eigen::Upper>().solve(rhs);
}

/// Straight lines over samples that are not valid, so that nothing that filters the output meets a hole.
void bridge(VectorXd& y, const std::vector<std::size_t>& valid) {
  for (std::size_t i = 0; i < valid.front(); ++i) y[as_index(i)] = y[as_index(valid.front())];
  for (std::size_t i = valid.back(); i < static_cast<std::size_t>(y.size()); ++i)
    y[as_index(i)] = y[as_index(valid.back())];
  for (std::size_t g = 0; g + 1 < valid.size(); ++g) {
    const double from = y[as_index(valid[g])];
    const double slope = (y[as_index(valid[g + 1])] - from) / static_cast<double>(valid[g + 1] - valid[g]);
    for (std::size_t i = valid[g] + 1; i < valid[g + 1]; ++i)
      y[as_index(i)] = from + slope * static_cast<double>(i - valid[g]);
  }
}

}  // namespace

Result<OutputErrorProblem> OutputErrorProblem::create(std::span<const Recording* const> recordings,
                                                      OffsetSharing sharing) {
  OutputErrorProblem problem;
  problem.sharing_ = sharing;
  if (recordings.empty()) return fail("no_samples", "there is no recording to identify from");
  problem.sample_time_s_ = recordings.front()->sample_period_s;
  double input_sum = 0;
  double output_sum = 0;
  std::size_t count = 0;
  bool input_moves = false;
  for (const Recording* recording : recordings) {
    const auto& u = recording->input.values;
    const auto& y = recording->output.values;
    if (std::abs(recording->sample_period_s - problem.sample_time_s_) > 1e-6 * problem.sample_time_s_) {
      return fail("sample_time_differs", fmt::format("{} is sampled every {} s, {} every {} s; identify needs one rate",
                                                     recordings.front()->name, problem.sample_time_s_, recording->name,
                                                     recording->sample_period_s));
    }
    Record record;
    for (std::size_t i = 0; i < y.size(); ++i) {
      if (!std::isfinite(u[i]) || (recording->is_valid(i) && !std::isfinite(y[i]))) {
        return fail("not_finite", fmt::format("{}: sample {} is not finite", recording->name, i + 1));
      }
      if (!recording->is_valid(i)) continue;
      record.valid.push_back(i);
      input_sum += u[i];
      output_sum += y[i];
      input_moves = input_moves || u[i] != u[record.valid.front()];
    }
    if (record.valid.empty()) return fail("no_samples", fmt::format("{} has no valid sample", recording->name));
    count += record.valid.size();
    record.u = Eigen::Map<const VectorXd>(u.data(), as_index(u.size()));
    record.y = Eigen::Map<const VectorXd>(y.data(), as_index(y.size()));
    bridge(record.y, record.valid);
    problem.records_.push_back(std::move(record));
  }
  if (!input_moves) {
    return fail("constant_input", "the input is constant: nothing tells how the output follows it");
  }
  problem.input_reference_ = input_sum / static_cast<double>(count);
  problem.output_reference_ = output_sum / static_cast<double>(count);
  for (Record& record : problem.records_) {
    record.u.array() -= problem.input_reference_;
    record.y.array() -= problem.output_reference_;
  }
  return problem;
}

Result<void> OutputErrorProblem::check_samples(const OutputErrorStructure& structure) const {
  std::size_t count = 0;
  for (const Record& record : records_) count += record.valid.size();
  const std::size_t parameters = static_cast<std::size_t>(structure.order + structure.zeros + 1) +
                                 records_.size() * static_cast<std::size_t>(structure.order + 1);
  if (count >= kSamplesPerParameter * parameters) return {};
  return fail("too_few_samples", fmt::format("{} valid samples are too few for order {}: {} parameters need {}", count,
                                             structure.order, parameters, kSamplesPerParameter * parameters));
}

std::size_t OutputErrorProblem::longest() const {
  std::size_t longest = 0;
  for (const Record& record : records_) longest = std::max(longest, static_cast<std::size_t>(record.y.size()));
  return longest;
}

RowSets OutputErrorProblem::rows(std::size_t at_most) const {
  std::size_t count = 0;
  for (const Record& record : records_) count += record.valid.size();
  const std::size_t stride = std::max<std::size_t>(1, (count + at_most - 1) / at_most);
  RowSets sets;
  for (const Record& record : records_) {
    auto& set = sets.emplace_back();
    for (std::size_t i = 0; i < record.valid.size(); i += stride) set.push_back(record.valid[i]);
  }
  return sets;
}

Index OutputErrorProblem::local_count(std::span<const Section> sections) const {
  return order_of(sections) + (shares_offset() ? 0 : 1);
}

Index OutputErrorProblem::shared_count(const OutputErrorStructure& structure) const {
  return structure.zeros + 1 + (shares_offset() ? 1 : 0);
}

OutputErrorProblem::Responses OutputErrorProblem::respond(const Record& record, std::span<const Section> sections,
                                                          int delay) const {
  const Index n = record.u.size();
  const Index order = order_of(sections);
  Responses r;
  r.rest = record.u[0];
  r.basis.resize(n, order + 1);
  const Index lag = std::min<Index>(delay, n);
  r.basis.col(order).head(lag).setConstant(r.rest);
  r.basis.col(order).tail(n - lag) = record.u.head(n - lag);
  run_cascade(sections, column(r.basis, order), r.rest, r.basis);
  r.free.resize(n, order);
  VectorXd impulse = VectorXd::Zero(n);
  impulse[0] = 1;
  run_cascade(sections, span_of(impulse), 0, r.free);
  return r;
}

OutputErrorProblem::Solution OutputErrorProblem::solve(std::span<const Section> sections,
                                                       const OutputErrorStructure& structure,
                                                       const RowSets& rows) const {
  const Index order = order_of(sections);
  const Index locals = local_count(sections);
  const Index shared = shared_count(structure);
  Solution solution;
  std::vector<MatrixXd> local_rows(records_.size());
  MatrixXd stack(as_index(records_.size()) * (shared + 1), shared + 1);
  stack.setZero();
  for (std::size_t r = 0; r < records_.size(); ++r) {
    if (rows[r].empty()) continue;
    const Responses responses = respond(records_[r], sections, structure.delay_samples);
    MatrixXd regression = MatrixXd::Ones(as_index(rows[r].size()), locals + shared + 1);  // offsets stay 1
    gather(responses.free, order, rows[r], regression, 0);
    gather(responses.basis, structure.zeros + 1, rows[r], regression, locals);
    gather(records_[r].y, 1, rows[r], regression, locals + shared);
    stack.middleRows(as_index(r) * (shared + 1), shared + 1) = eliminate_local(regression, locals, local_rows[r]);
    solution.count += rows[r].size();
  }
  const MatrixXd R = triangular_factor(stack);
  Index rank = 0;
  solution.shared = solve_least_squares(R.leftCols(shared), R.col(shared), &rank);
  solution.full_rank = rank == shared;
  solution.squares = (R.leftCols(shared) * solution.shared - R.col(shared)).squaredNorm();
  for (std::size_t r = 0; r < records_.size(); ++r) {
    solution.local.push_back(rows[r].empty() ? VectorXd(VectorXd::Zero(locals))
                                             : back_substitute(local_rows[r], locals, solution.shared));
  }
  return solution;
}

MatrixXd OutputErrorProblem::sensitivities(const Responses& responses, std::span<const Section> sections,
                                           const OutputErrorStructure& structure, const VectorXd& shared,
                                           const VectorXd& local) const {
  const Index n = responses.basis.rows();
  const Index order = order_of(sections);
  // A section's part is what passes it: its own outputs' share and that of the sections behind it.
  // ∂H/∂ln f = H (1 − z⁻¹ H)      ∂H/∂ln e = −(e / f) z⁻¹ (1 − z⁻¹) H²
  VectorXd driven = VectorXd::Zero(order);
  driven.head(std::min<Index>(order, structure.zeros + 1)) = shared.head(std::min<Index>(order, structure.zeros + 1));
  MatrixXd J(n, order);
  double part_at_rest = 0;
  Index column_of_section = 0;
  VectorXd part = VectorXd::Zero(n);
  for (std::size_t s = sections.size(); s-- > 0;) {
    const Section& section = sections[s];
    const Index at = column_of_section;
    part.noalias() += responses.basis.middleCols(at, section.order) * driven.segment(at, section.order);
    part.noalias() += responses.free.middleCols(at, section.order) * local.segment(at, section.order);
    part_at_rest += driven[at] * responses.rest;
    SectionState state(section, part_at_rest);
    const double ratio = section.order == 2 ? section.e / section.f : 0;
    double* const along_f = J.col(at).data();
    double* const along_e = section.order == 2 ? J.col(at + 1).data() : nullptr;
    for (Index t = 0; t < n; ++t) {
      along_f[t] = part[t] - state.level;
      if (along_e != nullptr) along_e[t] = -ratio * state.difference;
      state.step(part[t]);
    }
    column_of_section += section.order;
  }
  return J;
}

OutputErrorProblem::Projected OutputErrorProblem::project(std::span<const Section> sections,
                                                          const OutputErrorStructure& structure, const RowSets& rows,
                                                          const Solution& solution) const {
  const Index order = order_of(sections);
  const Index locals = local_count(sections);
  const Index shared = shared_count(structure);
  const Index rest = shared + order + 1;
  MatrixXd stack = MatrixXd::Zero(as_index(records_.size()) * rest, rest);
  for (std::size_t r = 0; r < records_.size(); ++r) {
    if (rows[r].empty()) continue;
    const Responses responses = respond(records_[r], sections, structure.delay_samples);
    const MatrixXd J = sensitivities(responses, sections, structure, solution.shared, solution.local[r]);
    MatrixXd regression = MatrixXd::Ones(as_index(rows[r].size()), locals + rest);
    gather(responses.free, order, rows[r], regression, 0);
    gather(responses.basis, structure.zeros + 1, rows[r], regression, locals);
    gather(J, order, rows[r], regression, locals + shared);
    gather(records_[r].y, 1, rows[r], regression, locals + shared + order);
    MatrixXd local_rows;
    stack.middleRows(as_index(r) * rest, rest) = eliminate_local(regression, locals, local_rows);
  }
  const MatrixXd R = triangular_factor(stack);
  return {R.block(shared, shared, order, order), R.block(shared, shared + order, order, 1)};
}

double OutputErrorProblem::solve_local(std::size_t recording, std::span<const Section> sections,
                                       const OutputErrorStructure& structure, std::span<const std::size_t> rows,
                                       Solution& solution) const {
  const Index order = order_of(sections);
  const Index locals = local_count(sections);
  const Responses responses = respond(records_[recording], sections, structure.delay_samples);
  solution.local[recording] = VectorXd::Zero(locals);
  const VectorXd driven = simulate(recording, sections, structure, solution);
  MatrixXd regression = MatrixXd::Ones(as_index(rows.size()), locals + 1);
  gather(responses.free, order, rows, regression, 0);
  gather(records_[recording].y - driven, 1, rows, regression, locals);
  MatrixXd local_rows;
  const MatrixXd left = eliminate_local(regression, locals, local_rows);
  solution.local[recording] = back_substitute(local_rows, locals, VectorXd());
  return left.squaredNorm();
}

VectorXd OutputErrorProblem::simulate(std::size_t recording, std::span<const Section> sections,
                                      const OutputErrorStructure& structure, const Solution& solution) const {
  const Responses responses = respond(records_[recording], sections, structure.delay_samples);
  const Index order = order_of(sections);
  const VectorXd& local = solution.local[recording];
  VectorXd y = responses.basis.leftCols(structure.zeros + 1) * solution.shared.head(structure.zeros + 1);
  y += responses.free * local.head(order);
  y.array() += shares_offset() ? solution.shared[structure.zeros + 1] : local[order];
  return y;
}

MatrixXd OutputErrorProblem::shared_sensitivities(std::size_t recording, std::span<const Section> sections,
                                                  const OutputErrorStructure& structure,
                                                  const Solution& solution) const {
  const Index order = order_of(sections);
  const Index locals = local_count(sections);
  const Index shared = shared_count(structure);
  const auto& rows = records_[recording].valid;
  const Responses responses = respond(records_[recording], sections, structure.delay_samples);
  const MatrixXd J = sensitivities(responses, sections, structure, solution.shared, solution.local[recording]);
  MatrixXd regression = MatrixXd::Ones(as_index(rows.size()), locals + shared + order);
  gather(responses.free, order, rows, regression, 0);
  gather(responses.basis, structure.zeros + 1, rows, regression, locals);
  gather(J, order, rows, regression, locals + shared);
  MatrixXd local_rows;
  eliminate_local(regression, locals, local_rows);
  const MatrixXd absorbed =
      local_rows.leftCols(locals).triangularView<Eigen::Upper>().solve(local_rows.rightCols(shared + order));
  MatrixXd result = MatrixXd::Zero(records_[recording].y.size(), shared + order);
  const MatrixXd left = regression.rightCols(shared + order) - regression.leftCols(locals) * absorbed;
  for (std::size_t i = 0; i < rows.size(); ++i) result.row(as_index(rows[i])) = left.row(as_index(i));
  return result;
}

std::vector<Section> OutputErrorProblem::steiglitz_mcbride_step(std::span<const Section> sections,
                                                                const OutputErrorStructure& structure,
                                                                const RowSets& rows) const {
  const Index order = order_of(sections);
  const Index locals = local_count(sections);
  const Index shared = shared_count(structure);
  const Index rest = shared + order + 1;
  MatrixXd stack = MatrixXd::Zero(as_index(records_.size()) * rest, rest);
  MatrixXd passed;
  for (std::size_t r = 0; r < records_.size(); ++r) {
    if (rows[r].empty()) continue;
    const Record& record = records_[r];
    const Responses responses = respond(record, sections, structure.delay_samples);
    passed.resize(record.y.size(), order);
    run_cascade(sections, span_of(record.y), record.y[0], passed);
    MatrixXd regression = MatrixXd::Ones(as_index(rows[r].size()), locals + rest);
    gather(responses.free, order, rows[r], regression, 0);
    gather(responses.basis, structure.zeros + 1, rows[r], regression, locals);
    gather(passed, order, rows[r], regression, locals + shared);
    gather(record.y, 1, rows[r], regression, locals + shared + order);
    MatrixXd local_rows;
    stack.middleRows(as_index(r) * rest, rest) = eliminate_local(regression, locals, local_rows);
  }
  const MatrixXd R = triangular_factor(stack);
  const VectorXd theta = solve_least_squares(R.leftCols(rest - 1), R.col(rest - 1));

  // y = Σ α_i (N_i / ∏D) y + …, so A = ∏D − Σ α_i N_i.
  const auto basis = basis_numerators(sections);
  DifferencePolynomial denominator_polynomial = basis.back();
  for (Index i = 0; i < order; ++i) {
    const DifferencePolynomial& numerator = basis[static_cast<std::size_t>(i)];
    for (std::size_t j = 0; j < numerator.size(); ++j) denominator_polynomial[j] -= theta[shared + i] * numerator[j];
  }
  auto poles = z_roots(denominator_polynomial);
  poles.resize(static_cast<std::size_t>(order), 0.0);  // roots at infinity in w are poles at 0
  return sections_from_poles(poles, limits());
}

}  // namespace valvetriage
