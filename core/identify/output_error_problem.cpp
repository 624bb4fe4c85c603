#include "core/identify/output_error_problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "core/identify/triangular_factor.h"
#include "core/recording/same_rate.h"

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

constexpr std::size_t kSettlingPeriod = 128;  // samples between looks at responses that have died out

/// Sections at work behind each other. All of them advance sample by sample: their recursions are independent within a
/// sample and overlap in the processor.
class Cascade {
 public:
  Cascade(std::span<const Section> sections, double rest) : count_(sections.size()) {
    for (std::size_t s = 0; s < count_; ++s) {
      states_[s] = SectionState(sections[s], rest);
      has_difference_[s] = sections[s].order == 2;
    }
  }

  void step(double x) {
    for (std::size_t s = 0; s < count_; ++s) x = states_[s].step(x);
    if (samples_++ % kSettlingPeriod == 0) {
      for (std::size_t s = 0; s < count_; ++s) states_[s].settle();
    }
  }

  const SectionState& state(std::size_t section) const { return states_[section]; }

  /// The first `columns` of y_m, v_m, y_(m−1), …, the order of basis_numerators.
  void write(MatrixXd& into, Index row, Index at, Index columns) const {
    const Index end = at + columns;
    for (std::size_t s = count_; s-- > 0 && at < end;) {
      into(row, at++) = states_[s].level;
      if (has_difference_[s] && at < end) into(row, at++) = states_[s].difference;
    }
  }

  /// Their sum with weights in the same order.
  double weighted(const VectorXd& weights) const {
    double sum = 0;
    Index i = 0;
    for (std::size_t s = count_; s-- > 0;) {
      sum += weights[i++] * states_[s].level;
      if (has_difference_[s]) sum += weights[i++] * states_[s].difference;
    }
    return sum;
  }

 private:
  std::array<SectionState, kMaxIdentifiedOrder> states_;
  std::array<bool, kMaxIdentifiedOrder> has_difference_{};
  std::size_t count_;
  std::size_t samples_ = 0;
};

/// The free run of one record in its parts, one sample after the other: nothing is kept that nobody asks for.
class Responses {
 public:
  Responses(const VectorXd& input, std::span<const Section> sections, int delay)
      : input_(input), delay_(delay), driven_(sections, input[0]), free_(sections, 0) {}

  void step() {
    delayed_ = input_[std::max<Index>(next_ - delay_, 0)];
    driven_.step(delayed_);
    free_.step(next_ == 0 ? 1 : 0);
    ++next_;
  }

  const Cascade& driven() const { return driven_; }  ///< by the delayed input
  const Cascade& free() const { return free_; }      ///< from an impulse at the first sample
  double delayed_input() const { return delayed_; }
  Index samples() const { return next_; }

 private:
  const VectorXd& input_;
  Index delay_;
  Cascade driven_, free_;
  double delayed_ = 0;
  Index next_ = 0;
};

struct NoColumns {
  static Index columns() { return 0; }
  void step(const Responses& /*responses*/) {}
  void write(MatrixXd& /*into*/, Index /*row*/, Index /*at*/) const {}
};

/// The measured output passed through the sections.
class PassedOutput {
 public:
  PassedOutput(const VectorXd& y, std::span<const Section> sections)
      : y_(y), order_(order_of(sections)), passed_(sections, y[0]) {}
  Index columns() const { return order_; }
  void step(const Responses& responses) { passed_.step(y_[responses.samples() - 1]); }
  void write(MatrixXd& into, Index row, Index at) const { passed_.write(into, row, at, order_); }

 private:
  const VectorXd& y_;
  Index order_;
  Cascade passed_;
};

/// Derivatives of the free run along the logarithms of the sections, the last section first.
/// A section's part is what passes it: its own outputs' share and that of the sections behind it.
/// ∂H/∂ln f = H (1 − z⁻¹ H)      ∂H/∂ln e = −(e / f) z⁻¹ (1 − z⁻¹) H²
class Sensitivities {
 public:
  Sensitivities(std::span<const Section> sections, const VectorXd& shared, Index numerators, const VectorXd& local,
                double rest)
      : sections_(sections), order_(order_of(sections)) {
    for (Index i = 0; i < order_; ++i) {
      const auto k = static_cast<std::size_t>(i);
      driven_[k] = i < numerators ? shared[i] : 0;
      free_[k] = local[i];
    }
    double part_at_rest = 0;
    std::size_t at = 0;
    for (std::size_t s = sections_.size(); s-- > 0; at += static_cast<std::size_t>(sections_[s].order)) {
      part_at_rest += driven_[at] * rest;
      states_[s] = SectionState(sections_[s], part_at_rest);
      ratios_[s] = sections_[s].order == 2 ? sections_[s].e / sections_[s].f : 0;
    }
  }

  Index columns() const { return order_; }

  void step(const Responses& responses) {
    double part = 0;
    std::size_t at = 0;
    for (std::size_t s = sections_.size(); s-- > 0; ++at) {
      const SectionState& driven = responses.driven().state(s);
      const SectionState& free = responses.free().state(s);
      part += driven_[at] * driven.level + free_[at] * free.level;
      if (sections_[s].order == 2) {
        part += driven_[at + 1] * driven.difference + free_[at + 1] * free.difference;
        values_[at + 1] = -ratios_[s] * states_[s].difference;
      }
      values_[at] = part - states_[s].level;
      if (sections_[s].order == 2) ++at;
      states_[s].step(part);
    }
  }

  void write(MatrixXd& into, Index row, Index at) const {
    for (Index j = 0; j < order_; ++j) into(row, at + j) = values_[static_cast<std::size_t>(j)];
  }

 private:
  std::span<const Section> sections_;
  Index order_;
  std::array<SectionState, kMaxIdentifiedOrder> states_;
  std::array<double, kMaxIdentifiedOrder> ratios_{}, driven_{}, free_{}, values_{};
};

/// One row per chosen sample; samples between are run through and leave nothing.
/// [free | own offset | driven | shared offset | further | y]
template <typename Layout, typename Further>
MatrixXd regression_at(const VectorXd& y, Responses responses, const Layout& layout, Further further,
                       std::span<const std::size_t> rows) {
  const Index at_further = layout.locals + layout.shared;
  const Index last = at_further + further.columns();
  MatrixXd regression = MatrixXd::Ones(as_index(rows.size()), last + 1);  // offsets stay 1
  for (Index i = 0; i < regression.rows(); ++i) {
    const Index t = as_index(rows[static_cast<std::size_t>(i)]);
    while (responses.samples() <= t) {
      responses.step();
      further.step(responses);
    }
    responses.free().write(regression, i, 0, layout.order);
    responses.driven().write(regression, i, layout.locals, std::min(layout.numerators, layout.order));
    if (layout.numerators > layout.order) regression(i, layout.locals + layout.order) = responses.delayed_input();
    further.write(regression, i, at_further);
    regression(i, last) = y[t];
  }
  return regression;
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
    if (!have_same_rate(*recording, *recordings.front())) {
      return fail(
          "sample_time_differs",
          fmt::format("{} is sampled every {} s, {} every {} s; what is fitted together needs one rate",
                      recordings.front()->name, problem.sample_time_s_, recording->name, recording->sample_period_s));
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

OutputErrorProblem::Layout OutputErrorProblem::layout_of(std::span<const Section> sections,
                                                         const OutputErrorStructure& structure) const {
  const Index order = order_of(sections);
  const Index numerators = structure.zeros + 1;
  return {.order = order,
          .locals = order + (shares_offset() ? 0 : 1),
          .numerators = numerators,
          .shared = numerators + (shares_offset() ? 1 : 0)};
}

OutputErrorProblem::Solution OutputErrorProblem::solve(std::span<const Section> sections,
                                                       const OutputErrorStructure& structure,
                                                       const RowSets& rows) const {
  const Layout layout = layout_of(sections, structure);
  const Index locals = layout.locals;
  const Index shared = layout.shared;
  Solution solution;
  std::vector<MatrixXd> local_rows(records_.size());
  MatrixXd stack(as_index(records_.size()) * (shared + 1), shared + 1);
  stack.setZero();
  for (std::size_t r = 0; r < records_.size(); ++r) {
    if (rows[r].empty()) continue;
    const Record& record = records_[r];
    const MatrixXd regression =
        regression_at(record.y, Responses(record.u, sections, structure.delay_samples), layout, NoColumns(), rows[r]);
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

OutputErrorProblem::Projected OutputErrorProblem::project(std::span<const Section> sections,
                                                          const OutputErrorStructure& structure, const RowSets& rows,
                                                          const Solution& solution) const {
  const Layout layout = layout_of(sections, structure);
  const Index order = layout.order;
  const Index shared = layout.shared;
  const Index rest = shared + order + 1;
  MatrixXd stack = MatrixXd::Zero(as_index(records_.size()) * rest, rest);
  for (std::size_t r = 0; r < records_.size(); ++r) {
    if (rows[r].empty()) continue;
    const Record& record = records_[r];
    const Sensitivities along(sections, solution.shared, layout.numerators, solution.local[r], record.u[0]);
    const MatrixXd regression =
        regression_at(record.y, Responses(record.u, sections, structure.delay_samples), layout, along, rows[r]);
    MatrixXd local_rows;
    stack.middleRows(as_index(r) * rest, rest) = eliminate_local(regression, layout.locals, local_rows);
  }
  const MatrixXd R = triangular_factor(stack);
  return {R.block(shared, shared, order, order), R.block(shared, shared + order, order, 1)};
}

double OutputErrorProblem::solve_local(std::size_t recording, std::span<const Section> sections,
                                       const OutputErrorStructure& structure, std::span<const std::size_t> rows,
                                       Solution& solution) const {
  const Layout layout = layout_of(sections, structure);
  const Index locals = layout.locals;
  const Record& record = records_[recording];
  const MatrixXd all =
      regression_at(record.y, Responses(record.u, sections, structure.delay_samples), layout, NoColumns(), rows);
  MatrixXd regression = all.leftCols(locals + 1);
  regression.col(locals) = all.rightCols(1) - all.middleCols(locals, layout.shared) * solution.shared;
  MatrixXd local_rows;
  const MatrixXd left = eliminate_local(regression, locals, local_rows);
  solution.local[recording] = back_substitute(local_rows, locals, VectorXd());
  return left.squaredNorm();
}

VectorXd OutputErrorProblem::simulate(std::size_t recording, std::span<const Section> sections,
                                      const OutputErrorStructure& structure, const Solution& solution) const {
  const Index order = order_of(sections);
  const Index numerators = structure.zeros + 1;
  const VectorXd& local = solution.local[recording];
  VectorXd weights = VectorXd::Zero(order + 1);
  weights.head(numerators) = solution.shared.head(numerators);
  const double offset = shares_offset() ? solution.shared[numerators] : local[order];
  VectorXd y(records_[recording].y.size());
  Responses responses(records_[recording].u, sections, structure.delay_samples);
  for (double& simulated : y) {
    responses.step();
    simulated = responses.driven().weighted(weights) + weights[order] * responses.delayed_input() +
                responses.free().weighted(local) + offset;
  }
  return y;
}

MatrixXd OutputErrorProblem::shared_sensitivities(std::size_t recording, std::span<const Section> sections,
                                                  const OutputErrorStructure& structure,
                                                  const Solution& solution) const {
  const Layout layout = layout_of(sections, structure);
  const Index locals = layout.locals;
  const Index others = layout.shared + layout.order;
  const Record& record = records_[recording];
  const Sensitivities along(sections, solution.shared, layout.numerators, solution.local[recording], record.u[0]);
  const MatrixXd regression =
      regression_at(record.y, Responses(record.u, sections, structure.delay_samples), layout, along, record.valid)
          .leftCols(locals + others);
  MatrixXd local_rows;
  eliminate_local(regression, locals, local_rows);
  const MatrixXd absorbed =
      local_rows.leftCols(locals).triangularView<Eigen::Upper>().solve(local_rows.rightCols(others));
  MatrixXd result = MatrixXd::Zero(record.y.size(), others);
  const MatrixXd left = regression.rightCols(others) - regression.leftCols(locals) * absorbed;
  for (std::size_t i = 0; i < record.valid.size(); ++i) result.row(as_index(record.valid[i])) = left.row(as_index(i));
  return result;
}

std::vector<Section> OutputErrorProblem::steiglitz_mcbride_step(std::span<const Section> sections,
                                                                const OutputErrorStructure& structure,
                                                                const RowSets& rows) const {
  const Layout layout = layout_of(sections, structure);
  const Index order = layout.order;
  const Index shared = layout.shared;
  const Index rest = shared + order + 1;
  MatrixXd stack = MatrixXd::Zero(as_index(records_.size()) * rest, rest);
  for (std::size_t r = 0; r < records_.size(); ++r) {
    if (rows[r].empty()) continue;
    const Record& record = records_[r];
    const MatrixXd regression = regression_at(record.y, Responses(record.u, sections, structure.delay_samples), layout,
                                              PassedOutput(record.y, sections), rows[r]);
    MatrixXd local_rows;
    stack.middleRows(as_index(r) * rest, rest) = eliminate_local(regression, layout.locals, local_rows);
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
