#include "core/identify/output_error_search.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

#include "core/identify/coloured_noise.h"
#include "core/identify/triangular_factor.h"
#include "core/linear_algebra/solve.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kBandwidths = 4;             // filters from the record's length to the sample: about a decade apart
constexpr double kFastestBandwidth = 0.7;  // per sample
constexpr int kSteiglitzMcBrideSteps = 3;  // more change nothing that the refinement does not
constexpr int kRefinedStarts = 3;          // the best so many starts are refined a little, the best of those to the end
constexpr int kShortRefinement = 8;
constexpr double kLongestStep = 2;  // e-folds of one coordinate in one iteration
constexpr int kDampings = 12;       // factors of ten tried for one step
constexpr std::size_t kLargestNoiseOrder = 24;
constexpr double kLogStep = 1e-5;  // central differences of closed formulas: errors about 1e-10

/// ln(limit / rate) where a section is slower than half the record, else 0.
double slowness(const Section& section, const SectionLimits& limits) {
  return std::max(0.0, std::log(limits.slow_rate / slowest_rate(section)));
}

double penalised(const OutputErrorProblem::Solution& solution, std::span<const Section> sections,
                 const SectionLimits& limits) {
  double penalty = 0;
  for (const Section& section : sections) penalty += std::pow(slowness(section, limits), 2);
  return solution.squares * (1 + penalty / static_cast<double>(std::max<std::size_t>(solution.count, 1)));
}

/// Coordinates in the order of the problem's sensitivities: the last section first, ln f then ln e.
std::vector<Section> moved(std::span<const Section> sections, const VectorXd& step, const SectionLimits& limits) {
  std::vector<Section> result(sections.begin(), sections.end());
  Index i = 0;
  for (auto section = result.rbegin(); section != result.rend(); ++section) {
    section->f *= std::exp(std::clamp(step[i++], -kLongestStep, kLongestStep));
    if (section->order == 2) section->e *= std::exp(std::clamp(step[i++], -kLongestStep, kLongestStep));
    *section = clamped(*section, limits);
  }
  return result;
}

struct NormalEquations {
  MatrixXd information;
  VectorXd gradient;
};

NormalEquations normal_equations(const OutputErrorProblem::Projected& projected, const FitCandidate& candidate,
                                 const SectionLimits& limits) {
  NormalEquations equations{projected.jacobian.transpose() * projected.jacobian,
                            projected.jacobian.transpose() * projected.residual};
  const double variance =
      candidate.solution.squares / static_cast<double>(std::max<std::size_t>(candidate.solution.count, 1));
  Index i = 0;
  for (auto section = candidate.sections.rbegin(); section != candidate.sections.rend(); ++section) {
    // The penalty's residual ln(limit e / f) has slope −1 along ln f and +1 along ln e.
    if (const double slow = slowness(*section, limits); slow > 0) {
      equations.information(i, i) += variance;
      equations.gradient[i] += variance * slow;
      if (section->order == 2) {
        equations.information(i + 1, i + 1) += variance;
        equations.information(i, i + 1) -= variance;
        equations.information(i + 1, i) -= variance;
        equations.gradient[i + 1] -= variance * slow;
      }
    }
    i += section->order;
  }
  return equations;
}

VectorXd damped_step(const NormalEquations& equations, double damping) {
  VectorXd scale = equations.information.diagonal();
  const double floor = 1e-12 * std::max(scale.maxCoeff(), 1e-300);
  scale = scale.cwiseMax(floor).cwiseSqrt();
  const MatrixXd scaled = scale.cwiseInverse().asDiagonal() * equations.information * scale.cwiseInverse().asDiagonal();
  const MatrixXd damped = scaled + damping * MatrixXd::Identity(scaled.rows(), scaled.cols());
  return solve_symmetric(damped, equations.gradient.cwiseQuotient(scale)).cwiseQuotient(scale);
}

struct Rational {
  DifferencePolynomial denominator, numerator;  // in w
};

Rational rational_of(std::span<const Section> sections, std::span<const double> numerator) {
  const auto basis = basis_numerators(sections);
  Rational r{basis.back(), DifferencePolynomial(numerator.size())};
  for (std::size_t i = 0; i < numerator.size(); ++i) {
    for (std::size_t j = 0; j < basis[i].size(); ++j) {
      if (j < r.numerator.size()) r.numerator[j] += numerator[i] * basis[i][j];
    }
  }
  return r;
}

/// a₁ … a_n, b₀ … b_m, static gain, as a function of what was estimated.
VectorXd coefficients_of(std::span<const Section> sections, std::span<const double> numerator) {
  const Rational r = rational_of(sections, numerator);
  const auto a = in_powers_of_delay(r.denominator);
  const auto b = in_powers_of_delay(r.numerator);
  VectorXd all(static_cast<Index>(a.size() + b.size()));
  std::copy(a.begin() + 1, a.end(), all.begin());
  std::copy(b.begin(), b.end(), all.begin() + static_cast<Index>(a.size()) - 1);
  all[all.size() - 1] = r.numerator[0] / r.denominator[0];  // w = 0 is z = 1
  return all;
}

/// Derivative of coefficients_of along the shared parameters and the logarithms of the sections.
MatrixXd coefficient_jacobian(const FitCandidate& candidate, Index shared) {
  const Index numerators = candidate.structure.zeros + 1;
  const Index order = candidate.structure.order;
  std::vector<double> numerator(candidate.solution.shared.begin(), candidate.solution.shared.begin() + numerators);
  MatrixXd jacobian = MatrixXd::Zero(order + numerators + 1, shared + order);
  for (Index i = 0; i < numerators; ++i) {
    std::vector<double> unit(static_cast<std::size_t>(numerators));
    unit[static_cast<std::size_t>(i)] = 1;
    jacobian.col(i) = coefficients_of(candidate.sections, unit);
    jacobian.col(i).head(order).setZero();  // the denominator does not know the numerator
  }
  for (Index i = 0; i < order; ++i) {
    std::vector<Section> up = candidate.sections;
    std::vector<Section> down = candidate.sections;
    Index at = 0;
    for (std::size_t s = up.size(); s-- > 0; at += candidate.sections[s].order) {
      if (i == at) up[s].f *= std::exp(kLogStep), down[s].f *= std::exp(-kLogStep);
      if (i == at + 1 && up[s].order == 2) up[s].e *= std::exp(kLogStep), down[s].e *= std::exp(-kLogStep);
    }
    jacobian.col(shared + i) = (coefficients_of(up, numerator) - coefficients_of(down, numerator)) / (2 * kLogStep);
  }
  return jacobian;
}

/// Covariance of shared parameters and sections' logarithms: (SᵀS)⁻¹ Sᵀ Γ S (SᵀS)⁻¹, Γ from an autoregressive residual.
MatrixXd parameter_covariance(const OutputErrorProblem& problem, const FitCandidate& candidate,
                              const std::vector<VectorXd>& residuals) {
  MatrixXd information_root;
  MatrixXd score_root;
  std::size_t count = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) count += problem.valid_rows(r).size();
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    MatrixXd S = problem.shared_sensitivities(r, candidate.sections, candidate.structure, candidate.solution);
    const Index p = S.cols();
    if (information_root.size() == 0) information_root = score_root = MatrixXd::Zero(2 * p, p);
    information_root.bottomRows(p) = triangular_factor(S);
    information_root.topRows(p) = triangular_factor(information_root);
    const auto noise = fit_coloured_noise(residuals[r], problem.valid_rows(r).size(), kLargestNoiseOrder);
    colour_backwards(noise, S);
    score_root.bottomRows(p) = std::sqrt(noise.innovation_variance) * triangular_factor(S);
    score_root.topRows(p) = triangular_factor(score_root);
  }
  const Index p = information_root.cols();
  const MatrixXd inverse = inverse_information(information_root.topRows(p));
  const MatrixXd half = score_root.topRows(p) * inverse;
  const double lost = static_cast<double>(p) + static_cast<double>(problem.recordings()) *
                                                   static_cast<double>(candidate.solution.local.front().size());
  const double samples = static_cast<double>(count);
  return half.transpose() * half * (samples / std::max(1.0, samples - lost));
}

/// Measured minus simulated, zero where not valid.
std::vector<VectorXd> residuals_of(const OutputErrorProblem& problem, const FreeRun& run) {
  std::vector<VectorXd> residuals;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    auto& residual = residuals.emplace_back(VectorXd::Zero(problem.output(r).size()));
    for (const std::size_t t : problem.valid_rows(r)) {
      const auto i = static_cast<Index>(t);
      residual[i] = problem.output(r)[i] + problem.output_reference() - run.simulated[r][t];
    }
  }
  return residuals;
}

TransferFunction transfer_function_of(const Rational& r, const FitCandidate& candidate, double sample_time_s) {
  TransferFunction g;
  g.domain = Domain::kZ;
  g.sample_time_s = sample_time_s;
  g.poles = poles_of(candidate.sections);
  g.zeros = z_roots(r.numerator);
  g.gain = in_powers_of_delay(r.numerator).front();
  const int delay = candidate.structure.delay_samples - (candidate.structure.order - candidate.structure.zeros);
  for (int i = delay; i < 0; ++i) g.zeros.emplace_back(0.0);
  g.delay_s = std::max(delay, 0) * sample_time_s;
  return g;
}

}  // namespace

FitCandidate evaluate(const OutputErrorProblem& problem, const OutputErrorStructure& structure, const RowSets& rows,
                      const Start& start) {
  FitCandidate candidate{.structure = structure,
                         .sections = start.sections,
                         .solution = problem.solve(start.sections, structure, rows),
                         .start = start.name};
  candidate.cost = penalised(candidate.solution, candidate.sections, problem.limits());
  return candidate;
}

FitCandidate refine(const OutputErrorProblem& problem, const RowSets& rows, FitCandidate candidate, int max_iterations,
                    double tolerance) {
  const SectionLimits limits = problem.limits();
  double damping = 1e-3;
  candidate.termination = Termination::kIterationLimit;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    ++candidate.iterations;
    const auto projected = problem.project(candidate.sections, candidate.structure, rows, candidate.solution);
    const NormalEquations equations = normal_equations(projected, candidate, limits);
    bool lowered = false;
    double change = 0;
    for (int attempt = 0; attempt < kDampings && !lowered; ++attempt) {
      const VectorXd step = damped_step(equations, damping);
      FitCandidate trial =
          evaluate(problem, candidate.structure, rows, {candidate.start, moved(candidate.sections, step, limits)});
      lowered = trial.cost < candidate.cost;
      if (lowered) {
        change = 1 - trial.cost / candidate.cost;
        trial.iterations = candidate.iterations;
        candidate = std::move(trial);
        damping = std::max(damping / 10, 1e-9);
      } else {
        damping *= 10;
      }
    }
    if (!lowered || change < tolerance) {
      candidate.termination = lowered ? Termination::kConverged : Termination::kNoDescent;
      break;
    }
  }
  if (!candidate.solution.full_rank) candidate.termination = Termination::kNotExcited;
  return candidate;
}

FitCandidate search(const OutputErrorProblem& problem, const OutputErrorStructure& structure, const RowSets& rows,
                    std::vector<Start> starts) {
  const SectionLimits limits = problem.limits();
  const double slowest = std::min(10.0 / static_cast<double>(problem.longest()), 0.1);
  for (int i = 0; i < kBandwidths; ++i) {
    const double rate = slowest * std::pow(kFastestBandwidth / slowest, static_cast<double>(i) / (kBandwidths - 1));
    starts.push_back({"steiglitz-mcbride", equal_sections(structure.order, rate, limits)});
  }
  std::vector<FitCandidate> candidates;
  for (const Start& start : starts) {
    FitCandidate best = evaluate(problem, structure, rows, start);
    Start stepped = start;
    const int steps = start.name == "steiglitz-mcbride" ? kSteiglitzMcBrideSteps : 1;
    for (int step = 0; step < steps; ++step) {
      stepped.sections = problem.steiglitz_mcbride_step(stepped.sections, structure, rows);
      FitCandidate next = evaluate(problem, structure, rows, stepped);
      if (next.cost < best.cost) best = std::move(next);
    }
    candidates.push_back(std::move(best));
  }
  const auto cheaper = [](const FitCandidate& a, const FitCandidate& b) { return a.cost < b.cost; };
  std::stable_sort(candidates.begin(), candidates.end(), cheaper);
  candidates.resize(std::min<std::size_t>(candidates.size(), kRefinedStarts));
  for (FitCandidate& candidate : candidates) {
    candidate = refine(problem, rows, std::move(candidate), kShortRefinement, 1e-6);
  }
  return *std::min_element(candidates.begin(), candidates.end(), cheaper);
}

Start start_from_poles(std::string name, std::span<const std::complex<double>> poles, int order,
                       const SectionLimits& limits) {
  std::vector<std::complex<double>> kept(poles.begin(), poles.end());
  std::stable_sort(kept.begin(), kept.end(), [](auto a, auto b) { return std::abs(a) > std::abs(b); });
  const auto wanted = static_cast<std::size_t>(order);
  if (kept.size() > wanted) {
    const bool splits_pair =
        kept[wanted - 1].imag() != 0 && std::abs(kept[wanted] - std::conj(kept[wanted - 1])) < 1e-12;
    kept.resize(wanted);
    if (splits_pair) kept.back() = std::abs(kept.back());
  }
  // Each further pole is distinctly faster than the one before: equal ones would leave the sections interchangeable.
  for (double fast = 0.5; kept.size() < wanted; fast *= 0.7) kept.emplace_back(fast);
  return {std::move(name), sections_from_poles(kept, limits)};
}

FreeRun run_of(const OutputErrorProblem& problem, const FitCandidate& candidate) {
  FreeRun run;
  double squares = 0;
  double spread = 0;
  std::size_t count = 0;
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    const auto& valid = problem.valid_rows(r);
    const VectorXd& y = problem.output(r);
    const VectorXd simulated = problem.simulate(r, candidate.sections, candidate.structure, candidate.solution);
    double mean = 0;
    for (const std::size_t t : valid) mean += y[static_cast<Index>(t)] / static_cast<double>(valid.size());
    for (const std::size_t t : valid) {
      const auto i = static_cast<Index>(t);
      squares += (y[i] - simulated[i]) * (y[i] - simulated[i]);
      spread += (y[i] - mean) * (y[i] - mean);
    }
    count += valid.size();
    auto& series = run.simulated.emplace_back(simulated.begin(), simulated.end());
    for (double& value : series) value += problem.output_reference();
    const double offset = problem.shares_offset() ? candidate.solution.shared[candidate.structure.zeros + 1]
                                                  : candidate.solution.local[r][candidate.structure.order];
    run.output_offsets.push_back(problem.output_reference() + offset);
  }
  run.input_offset = problem.input_reference();
  run.rmse = std::sqrt(squares / static_cast<double>(count));
  run.fit_percent = spread > 0 ? 100 * (1 - std::sqrt(squares / spread)) : 0;
  return run;
}

FitCandidate candidate_of(const OutputErrorProblem& problem, const RationalCoefficients& dynamics,
                          std::span<const std::complex<double>> poles) {
  const auto order = static_cast<int>(poles.size());
  FitCandidate candidate;
  candidate.structure = {order, order, dynamics.delay_samples};
  candidate.sections = sections_from_poles(poles, SectionLimits(std::numeric_limits<std::size_t>::max()));
  // The numerator in the cascade's basis: entry i of the basis has degree i.
  const auto basis = basis_numerators(candidate.sections);
  MatrixXd coordinates = MatrixXd::Zero(order + 1, order + 1);
  for (Index j = 0; j <= order; ++j) {
    const auto& polynomial = basis[static_cast<std::size_t>(j)];
    for (std::size_t i = 0; i < polynomial.size(); ++i) coordinates(static_cast<Index>(i), j) = polynomial[i];
  }
  std::vector<double> padded = dynamics.b;
  padded.resize(static_cast<std::size_t>(order) + 1);
  const auto in_w = in_powers_of_difference(padded);
  candidate.solution.shared = least_squares(coordinates, Eigen::Map<const VectorXd>(in_w.data(), order + 1));
  for (std::size_t r = 0; r < problem.recordings(); ++r) candidate.solution.local.emplace_back();
  for (std::size_t r = 0; r < problem.recordings(); ++r) {
    candidate.solution.squares +=
        problem.solve_local(r, candidate.sections, candidate.structure, problem.valid_rows(r), candidate.solution);
  }
  return candidate;
}

OutputErrorFit describe(const OutputErrorProblem& problem, const FitCandidate& candidate) {
  const OutputErrorStructure& structure = candidate.structure;
  OutputErrorFit fit;
  fit.structure = structure;
  fit.termination = candidate.termination;
  fit.iterations = candidate.iterations;
  fit.start = candidate.start;
  const Index numerators = structure.zeros + 1;
  const std::vector<double> numerator(candidate.solution.shared.begin(),
                                      candidate.solution.shared.begin() + numerators);
  const Rational rational = rational_of(candidate.sections, numerator);
  fit.transfer_function = transfer_function_of(rational, candidate, problem.sample_time_s());
  fit.coefficients.domain = Domain::kZ;
  fit.coefficients.sample_time_s = problem.sample_time_s();
  fit.coefficients.a = in_powers_of_delay(rational.denominator);
  fit.coefficients.b = in_powers_of_delay(rational.numerator);
  fit.coefficients.delay_samples = structure.delay_samples;
  fit.static_gain = rational.numerator[0] / rational.denominator[0];
  fit.run = run_of(problem, candidate);

  const MatrixXd covariance = parameter_covariance(problem, candidate, residuals_of(problem, fit.run));
  const MatrixXd jacobian = coefficient_jacobian(candidate, covariance.cols() - structure.order);
  const VectorXd errors = (jacobian * covariance * jacobian.transpose()).diagonal().cwiseMax(0).cwiseSqrt();
  fit.std_errors.a.assign(1, 0.0);
  fit.std_errors.a.insert(fit.std_errors.a.end(), errors.begin(), errors.begin() + structure.order);
  fit.std_errors.b.assign(errors.begin() + structure.order, errors.end() - 1);
  fit.std_errors.static_gain = errors[errors.size() - 1];
  return fit;
}

}  // namespace valvetriage
