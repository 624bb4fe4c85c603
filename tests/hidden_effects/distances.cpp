#include "tests/hidden_effects/distances.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <optional>

#include "tests/hidden_effects/output_rivals.h"

namespace valvetriage::hidden_effects {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using stand::EffectRequest;
using stand::Faults;
using stand::Unit;

constexpr std::size_t kRefined = 6;   // rivals of the screening that are fitted by twin runs
constexpr double kExcludedAt = 2.45;  // ½ d² = 3: twenty to one
constexpr int kIterations = 5;
constexpr double kWorthwhile = 0.01;  // share of the squared error that a step must promise
constexpr double kHopeless = 4;       // a fit by twin runs leaves a quarter of what the screening left, or more

/// What a fit may change beside the baseline: the numbers of a rival, the size of the other member of a pair.
struct FreeNumbers {
  const Rival* rival = nullptr;
  std::optional<EffectRequest> partner;

  Index count() const { return static_cast<Index>((rival ? rival->axes.size() : 0) + (partner ? 1 : 0)); }
};

/// Where a fit stands: coordinates of the free numbers, deviations of the baseline, and the stacked error.
struct Fit {
  VectorXd numbers, theta, rho;
  double squared() const { return rho.squaredNorm(); }
};

class Fitter {
 public:
  Fitter(const TwinBench& bench, const Absorption& baseline, const VectorXd& observed, FreeNumbers free)
      : bench_(bench), baseline_(baseline), observed_(observed), free_(std::move(free)) {}

  Fit at(const VectorXd& numbers, const VectorXd& theta) const {
    const VectorXd error = observed_ - simulated(numbers, theta);
    return {numbers, theta, baseline_.stacked(error, theta)};
  }

  /// Gauss-Newton from `numbers`; every accepted step lowers the error.
  Fit refined(const VectorXd& numbers, const VectorXd& theta) const {
    Fit best = at(numbers, theta);
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      const auto next = improved(best);
      if (!next) break;
      const bool settled = next->squared() > (1 - kWorthwhile) * best.squared();
      best = *next;
      if (settled) break;
    }
    return best;
  }

 private:
  std::vector<double> values(const VectorXd& numbers) const {
    std::vector<double> result;
    for (std::size_t i = 0; i < free_.rival->axes.size(); ++i)
      result.push_back(free_.rival->axes[i].value(numbers[static_cast<Index>(i)]));
    return result;
  }

  VectorXd simulated(const VectorXd& numbers, const VectorXd& theta) const {
    std::vector<Faults> faults = healthy(bench_);
    if (free_.partner)
      faults = bench_.faults({{free_.partner->effect, free_.partner->size * std::exp(numbers[numbers.size() - 1])}});
    const Unit unit = moved(bench_.unit(), theta.head(baseline_.parameters()));
    if (free_.rival)
      for (Faults& one : faults) free_.rival->apply(values(numbers), unit, one);
    const Index pasts = theta.size() - baseline_.parameters();
    return bench_.output(unit, faults) + baseline_.columns.rightCols(pasts) * theta.tail(pasts);
  }

  double step_of(Index number) const {
    if (!free_.rival || number >= static_cast<Index>(free_.rival->axes.size())) return 0.05;
    const Axis& axis = free_.rival->axes[static_cast<std::size_t>(number)];
    return axis.logarithmic ? 0.08 : 0.02 * (axis.high - axis.low);
  }

  std::optional<Fit> improved(const Fit& from) const {
    const Index n = free_.count();
    MatrixXd columns(from.rho.size(), n);
    for (Index i = 0; i < n; ++i) {
      const VectorXd there = at(from.numbers + step_of(i) * VectorXd::Unit(n, i), from.theta).rho;
      columns.col(i) = (from.rho - there) / step_of(i);  // minus the derivative of the error
    }
    VectorXd step = VectorXd::Zero(n);
    if (n > 0) {
      MatrixXd reduced(columns.rows(), n);
      for (Index i = 0; i < n; ++i) reduced.col(i) = baseline_.off_baseline(columns.col(i));
      const VectorXd left = baseline_.off_baseline(from.rho);
      MatrixXd normal = reduced.transpose() * reduced;
      normal.diagonal().array() += 1e-9 + 1e-6 * normal.diagonal().array();
      step = normal.ldlt().solve(reduced.transpose() * left);
      for (Index i = 0; i < n; ++i) step[i] = std::clamp(step[i], -12 * step_of(i), 12 * step_of(i));
    }
    if (baseline_.off_baseline(from.rho - columns * step).squaredNorm() > (1 - kWorthwhile) * from.squared())
      return std::nullopt;
    for (double share = 1; share > 0.2; share *= 0.5) {
      const VectorXd rest = from.rho - share * (columns * step);
      const VectorXd absorbed =
          share * baseline_.triangle.triangularView<Eigen::Upper>().solve(baseline_.basis.transpose() * rest);
      Fit next = at(from.numbers + share * step, from.theta + absorbed);
      if (next.squared() < from.squared()) return next;
    }
    return std::nullopt;
  }

  const TwinBench& bench_;
  const Absorption& baseline_;
  const VectorXd& observed_;
  FreeNumbers free_;
};

/// A rival's start from the screening: the entry and scale that leave least.
struct Start {
  std::size_t rival;
  std::vector<double> values;
  double left;
};

std::vector<Start> screened(const Absorption& baseline, const ScreeningGrid& grid, const VectorXd& rho) {
  const Index samples = baseline.columns.rows();
  const VectorXd left = baseline.off_baseline(rho);
  const Eigen::MatrixXf top = (baseline.basis.topRows(samples) / kNoisePsi).cast<float>();
  const Eigen::MatrixXf inside = top.transpose() * grid.signature;
  const Eigen::VectorXf along = grid.signature.transpose() * (left.head(samples) / kNoisePsi).cast<float>();
  std::vector<Start> best(simulated_rivals().size(), {0, {}, std::numeric_limits<double>::infinity()});
  for (std::size_t e = 0; e < grid.entries.size(); ++e) {
    const auto column = static_cast<Index>(e);
    const double energy =
        grid.signature.col(column).squaredNorm() / (kNoisePsi * kNoisePsi) - inside.col(column).squaredNorm();
    const double scale = std::clamp(along[column] / std::max(energy, 1e-12), 0.6, 1.7);
    const double remains = left.squaredNorm() - 2 * scale * along[column] + scale * scale * energy;
    const ScreeningGrid::Entry& entry = grid.entries[e];
    if (remains < best[entry.rival].left) {
      best[entry.rival] = {entry.rival, entry.values, remains};
      const Axis& size = simulated_rivals()[entry.rival].axes[0];
      if (size.logarithmic) best[entry.rival].values[0] *= scale;
    }
  }
  std::sort(best.begin(), best.end(), [](const Start& a, const Start& b) { return a.left < b.left; });
  return best;
}

VectorXd coordinates(const Start& start, bool partner) {
  const Rival& rival = simulated_rivals()[start.rival];
  VectorXd numbers = VectorXd::Zero(static_cast<Index>(rival.axes.size() + (partner ? 1 : 0)));
  for (std::size_t i = 0; i < rival.axes.size(); ++i)
    numbers[static_cast<Index>(i)] = rival.axes[i].coordinate(start.values[i]);
  return numbers;
}

double root(double squared) {
  return std::sqrt(std::max(squared, 0.0));
}

/// The distances of one hidden effect, the other member of a pair being present with its size free.
Distances told_from_rivals(const TwinBench& bench, const Absorption& baseline,
                           const std::function<const ScreeningGrid&()>& grid, const VectorXd& observed,
                           const std::string& hidden, const std::optional<EffectRequest>& partner,
                           const Wanted& wanted) {
  const Fit base = Fitter(bench, baseline, observed, {nullptr, partner})
                       .refined(VectorXd::Zero(partner ? 1 : 0), VectorXd::Zero(baseline.columns.cols()));
  Distances found{root(base.squared()), root(base.squared()), "none", 1};
  if (found.d < wanted.smallest_d) return found;
  const auto known = [&](const std::string& cause) { return cause == hidden || (partner && partner->effect == cause); };
  const auto consider = [&](const std::string& cause, double left) {
    if (left < kExcludedAt) ++found.oracle_set;
    if (left < found.d_name) {
      found.d_name = left;
      found.rival = cause;
    }
  };
  const auto whitened = [&](const VectorXd& column) { return baseline.off_baseline(baseline.stacked(column)); };
  const VectorXd healthy_psi = bench.output(bench.unit(), healthy(bench));
  for (const OutputFit& fit : output_rivals(bench, healthy_psi, baseline.off_baseline(base.rho), whitened))
    if (!known(fit.cause)) consider(fit.cause, root(fit.left));
  std::size_t refined = 0;
  for (const Start& start : screened(baseline, grid(), base.rho)) {
    const Rival& rival = simulated_rivals()[start.rival];
    if (known(rival.cause)) continue;
    if (++refined > kRefined) break;
    if (found.d_name < wanted.smallest_d_name) break;
    if (refined == 4 && found.d_name > 3 * wanted.largest_d_name) break;
    if (root(start.left) > kHopeless * (found.d_name + 1)) break;
    const Fitter fitting(bench, baseline, observed, {&rival, partner});
    consider(rival.cause, root(fitting.refined(coordinates(start, partner.has_value()), base.theta).squared()));
  }
  return found;
}

}  // namespace

ScreeningGrid screening_grid(const std::vector<std::string>& tests) {
  const TwinBench bench = nominal_bench(tests);
  const VectorXd output = bench.output(bench.unit(), healthy(bench));
  ScreeningGrid grid;
  for (std::size_t r = 0; r < simulated_rivals().size(); ++r) {
    const Rival& rival = simulated_rivals()[r];
    const std::vector<double> shapes = rival.axes.size() > 1 ? rival.axes[1].starts : std::vector<double>{0};
    for (const double size : rival.axes[0].starts)
      for (const double shape : shapes)
        grid.entries.push_back(
            {r, rival.axes.size() > 1 ? std::vector<double>{size, shape} : std::vector<double>{size}});
  }
  grid.signature.resize(bench.samples(), static_cast<Index>(grid.entries.size()));
  for (std::size_t e = 0; e < grid.entries.size(); ++e) {
    std::vector<Faults> faults = healthy(bench);
    for (Faults& one : faults)
      simulated_rivals()[grid.entries[e].rival].apply(grid.entries[e].values, bench.unit(), one);
    grid.signature.col(static_cast<Index>(e)) = (bench.output(bench.unit(), faults) - output).cast<float>();
  }
  return grid;
}

DistanceMeter::DistanceMeter(const std::vector<std::string>& tests)
    : tests_(tests), baseline_(std::make_shared<const Absorption>(nominal_bench(tests))) {}

Distances DistanceMeter::measure(const stand::SessionOptions& options, const Wanted& wanted) {
  const TwinBench bench(options);
  const auto grid = [this]() -> const ScreeningGrid& {
    if (!grid_) grid_ = std::make_shared<const ScreeningGrid>(screening_grid(tests_));
    return *grid_;
  };
  const VectorXd observed = bench.output(bench.unit(), bench.faults(options.effects));
  if (options.effects.size() == 1)
    return told_from_rivals(bench, *baseline_, grid, observed, options.effects[0].effect, std::nullopt, wanted);
  Distances worst;
  worst.d_name = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 2; ++i) {
    const Distances one =
        told_from_rivals(bench, *baseline_, grid, observed, options.effects[i].effect, options.effects[1 - i], wanted);
    if (one.d_name < worst.d_name) worst = one;
    if (worst.d_name < wanted.smallest_d_name) return worst;
  }
  const Fit together =
      Fitter(bench, *baseline_, observed, {}).refined(VectorXd::Zero(0), VectorXd::Zero(baseline_->columns.cols()));
  worst.d = root(together.squared());
  return worst;
}

}  // namespace valvetriage::hidden_effects
