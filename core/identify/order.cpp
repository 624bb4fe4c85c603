#include "core/identify/order.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/identify/arx.h"
#include "core/identify/output_error_search.h"

namespace valvetriage {
namespace {

constexpr std::size_t kBlocks = 6;
constexpr std::size_t kMostFolds = 6;
constexpr int kFoldIterations = 3;  // from the fit to all samples a fold's own optimum is near
constexpr int kDelayIterations = 3;
constexpr double kIndifferent = 0.005;       // half a percent of rms: below, a structure buys nothing a user could see
constexpr int kPatience = 2;                 // orders without gain after which none is expected
constexpr int kMostDelay = 200;              // samples
constexpr std::size_t kRecordPerDelay = 20;  // a delay longer than a twentieth of the record is not looked for

/// What is fitted and what is judged.
struct Fold {
  RowSets fit;
  RowSets judged;
  bool whole_recordings = false;
};

std::vector<Fold> folds_by_recording(const RowSets& rows) {
  const std::size_t count = std::min(kMostFolds, rows.size());
  std::vector<Fold> folds(count, {rows, RowSets(rows.size()), true});
  for (std::size_t r = 0; r < rows.size(); ++r) std::swap(folds[r % count].fit[r], folds[r % count].judged[r]);
  return folds;
}

std::vector<Fold> folds_by_block(const std::vector<std::size_t>& rows) {
  std::vector<Fold> folds;
  for (std::size_t block = 1; block < kBlocks; ++block) {
    const auto begin = rows.begin() + static_cast<std::ptrdiff_t>(rows.size() * block / kBlocks);
    const auto end = rows.begin() + static_cast<std::ptrdiff_t>(rows.size() * (block + 1) / kBlocks);
    Fold fold{{std::vector<std::size_t>(rows.begin(), begin)}, {std::vector<std::size_t>(begin, end)}, false};
    fold.fit[0].insert(fold.fit[0].end(), end, rows.end());
    folds.push_back(std::move(fold));
  }
  return folds;
}

/// A structure with its fit to all rows and the logarithm of its rms error on each fold.
struct Scored {
  FitCandidate candidate;
  std::vector<double> log_rms;
  double mean = 0;
};

class Chooser {
 public:
  Chooser(const OutputErrorProblem& problem, std::span<const Recording* const> recordings, const OrderOptions& options)
      : problem_(problem), recordings_(recordings), options_(options), rows_(problem.rows(options.max_rows)) {
    folds_ = problem.recordings() > 1 ? folds_by_recording(rows_) : folds_by_block(rows_.front());
    double squares = 0;
    std::size_t count = 0;
    for (std::size_t r = 0; r < problem.recordings(); ++r) {
      squares += problem.output(r).squaredNorm();
      count += problem.samples(r);
    }
    rounding_ = 1e-9 * std::sqrt(squares / static_cast<double>(count)) + 1e-300;
  }

  OrderChoice choose() {
    const int first = options_.order.value_or(1);
    const int last = options_.order.value_or(options_.largest_order);
    int delay = options_.delay_samples.value_or(-1);
    int without_gain = 0;
    std::vector<std::complex<double>> previous;
    for (int order = first; order <= last && without_gain < kPatience; ++order) {
      const OutputErrorStructure structure{order, options_.zeros.value_or(order - 1), std::max(delay, 0)};
      if (!fits(structure)) continue;
      FitCandidate candidate = fitted(structure, previous);
      if (delay < 0) candidate = scanned_delay(std::move(candidate));
      if (!options_.delay_samples) candidate = climbed_delay(std::move(candidate));
      delay = candidate.structure.delay_samples;
      previous = poles_of(candidate.sections);
      const double best_before = best_mean();
      score(std::move(candidate));
      without_gain = scored_.back().mean < best_before - kIndifferent ? 0 : without_gain + 1;
    }
    if (!options_.zeros) {
      add_a_zero();
      drop_zeros();
    }
    return chosen();
  }

 private:
  bool fits(const OutputErrorStructure& s) const { return s.zeros <= s.order && problem_.check_samples(s).has_value(); }

  FitCandidate fitted(const OutputErrorStructure& structure, std::span<const std::complex<double>> previous) const {
    std::vector<Start> starts;
    if (const auto arx = fit_arx(recordings_, structure)) {
      starts.push_back(start_from_poles("arx", z_roots(in_powers_of_difference(arx->coefficients.a)), structure.order,
                                        problem_.limits()));
    }
    if (!previous.empty()) {
      starts.push_back(start_from_poles("lower order", previous, structure.order, problem_.limits()));
    }
    return search(problem_, structure, rows_, std::move(starts));
  }

  FitCandidate with_structure(const FitCandidate& from, const OutputErrorStructure& structure, int iterations) const {
    return refine(problem_, rows_, evaluate(problem_, structure, rows_, {from.start, from.sections}), iterations, 1e-4);
  }

  FitCandidate with_delay(const FitCandidate& from, int delay) const {
    OutputErrorStructure structure = from.structure;
    structure.delay_samples = delay;
    return with_structure(from, structure, kDelayIterations);
  }

  /// Clearly lower: by more than four units of χ², what one parameter gains by luck once in twenty.
  static bool clearly_lower(const FitCandidate& a, const FitCandidate& b) {
    return a.cost < b.cost * (1 - 4.0 / static_cast<double>(b.solution.count));
  }

  int most_delay() const {
    return static_cast<int>(std::min<std::size_t>(kMostDelay, problem_.longest() / kRecordPerDelay));
  }

  /// Coarse: delays a factor 1.5 apart.
  FitCandidate scanned_delay(FitCandidate best) const {
    for (int delay = 1; delay <= most_delay(); delay = std::max(delay + 1, delay * 3 / 2)) {
      FitCandidate trial = with_delay(best, delay);
      if (clearly_lower(trial, best)) best = std::move(trial);
    }
    return best;
  }

  /// Fine: down, then up, in growing and then shrinking steps, as long as it pays.
  FitCandidate climbed_delay(FitCandidate best) const {
    for (const int direction : {-1, 1}) {
      int step = 1;
      bool growing = true;
      while (step > 0) {
        const int delay = best.structure.delay_samples + direction * step;
        bool lower = false;
        if (delay >= 0 && delay <= most_delay()) {
          FitCandidate trial = with_delay(best, delay);
          lower = clearly_lower(trial, best);
          if (lower) best = std::move(trial);
        }
        growing = growing && lower;
        step = growing ? step * 2 : step / 2;
      }
    }
    return best;
  }

  const Scored& score(FitCandidate candidate) {
    Scored scored;
    scored.candidate = std::move(candidate);
    for (const Fold& fold : folds_) {
      const FitCandidate fit = refine(
          problem_, fold.fit,
          evaluate(problem_, scored.candidate.structure, fold.fit, {scored.candidate.start, scored.candidate.sections}),
          kFoldIterations, 1e-4);
      scored.log_rms.push_back(std::log(judged_rms(fold, fit) + rounding_));
    }
    scored.mean =
        std::accumulate(scored.log_rms.begin(), scored.log_rms.end(), 0.0) / static_cast<double>(folds_.size());
    scored_.push_back(std::move(scored));
    return scored_.back();
  }

  double judged_rms(const Fold& fold, const FitCandidate& fit) const {
    double squares = 0;
    std::size_t count = 0;
    auto solution = fit.solution;
    for (std::size_t r = 0; r < fold.judged.size(); ++r) {
      const auto& judged = fold.judged[r];
      if (judged.empty()) continue;
      count += judged.size();
      if (fold.whole_recordings) {
        squares += problem_.solve_local(r, fit.sections, fit.structure, judged, solution);
        continue;
      }
      const Eigen::VectorXd simulated = problem_.simulate(r, fit.sections, fit.structure, solution);
      for (const std::size_t t : judged) {
        const auto i = static_cast<Eigen::Index>(t);
        squares += std::pow(problem_.output(r)[i] - simulated[i], 2);
      }
    }
    return std::sqrt(squares / static_cast<double>(std::max<std::size_t>(count, 1)));
  }

  double best_mean() const {
    double best = INFINITY;
    for (const Scored& scored : scored_) best = std::min(best, scored.mean);
    return best;
  }

  const Scored& best() const {
    return *std::min_element(scored_.begin(), scored_.end(),
                             [](const Scored& a, const Scored& b) { return a.mean < b.mean; });
  }

  /// Within one standard error over the folds, or half a percent, of the other.
  static bool as_good(const Scored& a, const Scored& b) {
    const double n = static_cast<double>(a.log_rms.size());
    const double mean = a.mean - b.mean;
    double squares = 0;
    for (std::size_t i = 0; i < a.log_rms.size(); ++i) {
      squares += std::pow(a.log_rms[i] - b.log_rms[i] - mean, 2);
    }
    const double standard_error = n > 1 ? std::sqrt(squares / (n - 1) / n) : 0;
    return mean <= std::max(standard_error, kIndifferent);
  }

  const Scored& simplest_as_good() const {
    const auto simpler = [](const Scored* a, const Scored* b) {
      const auto& s = a->candidate.structure;
      const auto& t = b->candidate.structure;
      return s.order != t.order ? s.order < t.order : s.zeros < t.zeros;
    };
    const Scored& target = best();
    const Scored* chosen = &target;
    for (const Scored& scored : scored_) {
      if (as_good(scored, target) && simpler(&scored, chosen)) chosen = &scored;
    }
    return *chosen;
  }

  /// A free numerator b₀ … b_n with the delay it needs: half samples and filters that the plant's own zeros do not
  /// know.
  void add_a_zero() {
    const FitCandidate base = simplest_as_good().candidate;
    OutputErrorStructure more = base.structure;
    if (++more.zeros > more.order || !fits(more)) return;
    FitCandidate wider = with_structure(base, more, kDelayIterations);
    if (more.delay_samples > 0 && !options_.delay_samples) {
      --more.delay_samples;
      FitCandidate earlier = with_structure(base, more, kDelayIterations);
      if (earlier.cost < wider.cost) wider = std::move(earlier);
    }
    score(std::move(wider));
  }

  /// One coefficient less at either end of the numerator, as long as that costs nothing.
  void drop_zeros() {
    while (true) {
      const Scored base = simplest_as_good();
      OutputErrorStructure fewer = base.candidate.structure;
      if (fewer.zeros == 0) return;
      --fewer.zeros;
      FitCandidate narrower = with_structure(base.candidate, fewer, kDelayIterations);
      if (!options_.delay_samples) {
        ++fewer.delay_samples;
        FitCandidate later = with_structure(base.candidate, fewer, kDelayIterations);
        if (later.cost < narrower.cost) narrower = std::move(later);
      }
      const auto known = std::any_of(scored_.begin(), scored_.end(), [&](const Scored& s) {
        const auto& t = s.candidate.structure;
        return t.order == narrower.structure.order && t.zeros == narrower.structure.zeros;
      });
      if (known) return;
      score(std::move(narrower));
      if (!as_good(scored_.back(), best())) return;
    }
  }

  OrderChoice chosen() const {
    const Scored& winner = simplest_as_good();
    OrderChoice choice;
    choice.structure = winner.candidate.structure;
    choice.poles = poles_of(winner.candidate.sections);
    for (const Scored& scored : scored_) {
      const auto& structure = scored.candidate.structure;
      choice.tried.push_back(
          {structure, dead_time_samples(structure) * problem_.sample_time_s(), std::exp(scored.mean)});
    }
    const Scored& lowest = best();
    choice.reason =
        &winner == &lowest
            ? fmt::format("order {} has the lowest held-out error of the {} structures tried", choice.structure.order,
                          scored_.size())
            : fmt::format(
                  "order {} is the simplest of the {} structures tried within one standard error or "
                  "half a percent of the lowest held-out error ({:.4g}, order {})",
                  choice.structure.order, scored_.size(), std::exp(lowest.mean), lowest.candidate.structure.order);
    return choice;
  }

  const OutputErrorProblem& problem_;
  std::span<const Recording* const> recordings_;
  const OrderOptions& options_;
  RowSets rows_;
  std::vector<Fold> folds_;
  std::vector<Scored> scored_;
  double rounding_ = 0;  // of a free run: what an exact model leaves
};

}  // namespace

int dead_time_samples(const OutputErrorStructure& structure) {
  return std::max(0, structure.delay_samples - (structure.order - structure.zeros));
}

Result<OrderChoice> choose_order(std::span<const Recording* const> recordings, const OrderOptions& options) {
  const int order = options.order.value_or(options.largest_order);
  const OutputErrorStructure widest{order, options.zeros.value_or(0), options.delay_samples.value_or(0)};
  if (const auto checked = check_structure(widest); !checked) return tl::unexpected(checked.error());
  const auto problem = OutputErrorProblem::create(recordings, options.offsets);
  if (!problem) return tl::unexpected(problem.error());
  const int least_order = options.order.value_or(std::max(1, options.zeros.value_or(0)));
  const OutputErrorStructure smallest{least_order, options.zeros.value_or(std::max(0, least_order - 1)), 0};
  if (const auto enough = problem->check_samples(smallest); !enough) return tl::unexpected(enough.error());
  return Chooser(*problem, recordings, options).choose();
}

}  // namespace valvetriage
