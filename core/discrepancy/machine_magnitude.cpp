#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "core/discrepancy/machine_trials.h"

namespace valvetriage {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMostRows = 1500;
constexpr int kAlternations = 25;
constexpr std::size_t kKept = 4;
constexpr std::size_t kParents = 8;

/// Linear machines whose magnitude might be the reading: poles given, numerator by alternating between the signs and
/// least squares (a phase retrieval).
struct Guess {
  std::vector<Section> sections;
  VectorXd numerator;
  double squares = 0;
};

/// Rates [1/s] from a few per record to nearly one per sample.
std::vector<double> rates_of(double period_s, double longest_s) {
  const double slowest = 3 / longest_s, fastest = 0.8 / period_s;
  constexpr int kRates = 10;
  std::vector<double> rates;
  for (int i = 0; i < kRates; ++i) {
    rates.push_back(slowest * std::pow(fastest / slowest, (i + 0.5) / kRates));
  }
  return rates;
}

std::vector<std::vector<std::complex<double>>> pole_sets(double period_s, double longest_s) {
  std::vector<std::vector<std::complex<double>>> sets;
  const std::vector<double> rates = rates_of(period_s, longest_s);
  for (const double rate : rates) {
    const double p = std::exp(-rate * period_s);
    sets.push_back({p});
    for (const double other : rates) {
      if (other > rate * 1.5) sets.push_back({p, std::exp(-other * period_s)});
    }
    for (const double damping : {0.15, 0.4, 0.75}) {
      const double angle = rate * period_s * std::sqrt(1 - damping * damping);
      if (angle > 0.9 * std::numbers::pi) continue;
      const auto pole = std::exp(-damping * rate * period_s) * std::complex<double>(std::cos(angle), std::sin(angle));
      sets.push_back({pole, std::conj(pole)});
    }
  }
  return sets;
}

Guess retrieve(const MatrixXd& basis, const VectorXd& magnitude, const VectorXd& first_signs) {
  const auto solver = basis.colPivHouseholderQr();
  VectorXd signs = first_signs;
  Guess guess;
  for (int i = 0; i < kAlternations; ++i) {
    guess.numerator = solver.solve(signs.cwiseProduct(magnitude));
    const VectorXd signal = basis * guess.numerator;
    guess.squares = (signal.cwiseAbs() - magnitude).squaredNorm();
    VectorXd next = signal.unaryExpr([](double x) { return x < 0 ? -1.0 : 1.0; });
    if (next == signs) break;
    signs = std::move(next);
  }
  return guess;
}

struct Rows {
  std::vector<std::pair<std::size_t, std::size_t>> at;  ///< record, sample
};

Rows thinned(const MachineData& data) {
  Rows rows;
  std::size_t total = 0;
  for (const MachineRecord& record : data.records) total += record.valid.size();
  const std::size_t step = std::max<std::size_t>(1, total / kMostRows);
  for (std::size_t r = 0; r < data.records.size(); ++r) {
    for (std::size_t i = 0; i < data.records[r].valid.size(); i += step)
      rows.at.emplace_back(r, data.records[r].valid[i]);
  }
  return rows;
}

/// Basis signals of the sections at the rows, for an input that is about zero in its own unit, and a constant.
MatrixXd basis_at(const MachineData& data, const Rows& rows, const MachineBlock& block) {
  MatrixXd at(static_cast<Index>(rows.at.size()), static_cast<Index>(block.numerator.size()) + 1);
  std::vector<MatrixXd> all;
  for (const MachineRecord& record : data.records) all.push_back(linear_basis(block, {}, record.input));
  for (std::size_t i = 0; i < rows.at.size(); ++i) {
    const auto [r, t] = rows.at[i];
    at.row(static_cast<Index>(i)) << all[r].row(static_cast<Index>(t)), 1.0;
  }
  return at;
}

MachineFit as_fit(const Guess& guess, const MachineBlock& linear, double zero, double period_s) {
  MachineFit fit;
  fit.machine.sample_period_s = period_s;
  MachineBlock block = linear;
  const Index terms = guess.numerator.size() - 1;
  block.numerator.assign(guess.numerator.begin(), guess.numerator.begin() + terms);
  MachineBlock offset, fold;
  offset.law = MachineLaw::kAffine;
  offset.parameters = {1, zero + guess.numerator[terms]};
  fold.law = MachineLaw::kMagnitude;
  fold.parameters = {zero};
  fit.machine.blocks = {block, offset, fold};
  fit.free = free_dynamics(block, 0);
  fit.free.push_back({1, MachineField::kParameter, 1, false, -1e3, 1e3});
  return fit;
}

MachineBlock block_of_poles(const std::vector<std::complex<double>>& poles) {
  MachineBlock block;
  block.sections = sections_from_poles(poles, SectionLimits(1'000'000'000));
  block.delay_samples = 0;
  block.numerator.assign(poles.size() + 1, 0.0);
  return block;
}

using Guesses = std::vector<std::pair<Guess, MachineBlock>>;

void sort_by_squares(Guesses& guesses) {
  std::stable_sort(guesses.begin(), guesses.end(),
                   [](const auto& a, const auto& b) { return a.first.squares < b.first.squares; });
}

/// The best guesses with one more lag each, from the signs that they ended with: a motor in front of what it turns.
Guesses with_a_lag(const MachineData& data, const Rows& rows, const VectorXd& magnitude, double longest_s,
                   const Guesses& guesses) {
  Guesses longer;
  std::vector<double> seen;  // squares of the parents: equal ones are the same guess, reached from other signs
  for (const auto& [guess, block] : guesses) {
    if (seen.size() == kParents) break;
    if (!seen.empty() && guess.squares <= seen.back() * (1 + 1e-9)) continue;
    seen.push_back(guess.squares);
    const VectorXd signs =
        (basis_at(data, rows, block) * guess.numerator).unaryExpr([](double x) { return x < 0 ? -1.0 : 1.0; });
    for (const double rate : rates_of(data.period_s, longest_s)) {
      auto poles = poles_of(block.sections);
      poles.emplace_back(std::exp(-rate * data.period_s));
      const MachineBlock next = block_of_poles(poles);
      longer.emplace_back(retrieve(basis_at(data, rows, next), magnitude, signs), next);
    }
  }
  return longer;
}

/// Whether the readings stay on one side of zero and come close to it: what a magnitude does.
bool looks_folded(const MachineGround& g) {
  const double above = g.output_low - g.output_zero;
  return above > -0.02 * g.output_range() && above < 0.1 * g.output_range();
}

}  // namespace

MachineTrial magnitude_trial(const MachineData& data, const MachineGround& g) {
  MachineTrial trial{{"rectified_sensor"}, "at the reading", {}};
  if (!looks_folded(g) || g.one_rate) return trial;
  const Rows rows = thinned(data);
  VectorXd magnitude(static_cast<Index>(rows.at.size()));
  for (std::size_t i = 0; i < rows.at.size(); ++i) {
    magnitude[static_cast<Index>(i)] = data.records[rows.at[i].first].output[rows.at[i].second] - g.output_zero;
  }
  Guesses guesses;
  for (const auto& poles : pole_sets(data.period_s, g.longest_s)) {
    const MachineBlock block = block_of_poles(poles);
    const MatrixXd basis = basis_at(data, rows, block);
    for (Index column = 0; column < std::min<Index>(basis.cols() - 1, 2); ++column) {
      // Signs of the state itself, about its mean and about the input's zero.
      for (const double centre : {basis.col(column).mean(), column == 0 ? g.input_zero : 0.0}) {
        const VectorXd signs = basis.col(column).unaryExpr([&](double x) { return x < centre ? -1.0 : 1.0; });
        guesses.emplace_back(retrieve(basis, magnitude, signs), block);
      }
    }
  }
  sort_by_squares(guesses);
  Guesses longer = with_a_lag(data, rows, magnitude, g.longest_s, guesses);
  sort_by_squares(longer);
  for (const Guesses* kind : {&guesses, &longer}) {
    for (std::size_t i = 0; i < std::min(kKept, kind->size()); ++i) {
      trial.starts.push_back(as_fit((*kind)[i].first, (*kind)[i].second, g.output_zero, data.period_s));
    }
  }
  return trial;
}

}  // namespace valvetriage
