#include "core/identify/response_order.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace valvetriage {
namespace {

using Complex = std::complex<double>;

constexpr int kFolds = 5;
constexpr int kFoldIterations = 6;  // from the fit to all points a fold's own optimum is near
// Of an order that was asked for: a resonance far narrower than the points lie apart is known by its skirts. A search
// over orders would find one on the noise of a single point.
constexpr double kNarrowestAskedFor = 0.1;
constexpr double kIndifferent = 0.01;  // of the squared error: half a percent of rms

/// One order fitted to all points and judged on each fold.
struct Scored {
  ResponseModel model;
  TriedResponseOrder line;
  std::vector<double> log_error;  ///< per fold
  double mean() const {
    double sum = 0;
    for (const double e : log_error) sum += e / static_cast<double>(log_error.size());
    return sum;
  }
};

ResponseModel model_of(RationalFit fit) {
  ResponseModel model{.kind = ResponseModelKind::kRational};
  model.transfer_function = std::move(fit.transfer_function);
  model.pole_std_errors = std::move(fit.pole_std_errors);
  model.zero_std_errors = std::move(fit.zero_std_errors);
  model.static_gain = fit.static_gain;
  model.static_gain_std_error = fit.static_gain_std_error;
  model.delay_std_error_s = fit.delay_std_error_s;
  model.misfit_per_freedom = fit.misfit_per_freedom;
  model.termination = fit.termination;
  return model;
}

ResponseModel model_of(const AsymptoticFit& fit, std::size_t points) {
  ResponseModel model{.kind = ResponseModelKind::kAsymptotic};
  model.transfer_function = fit.transfer_function;
  model.pole_std_errors = fit.pole_std_errors;
  model.zero_std_errors = fit.zero_std_errors;
  model.static_gain = fit.static_gain;
  model.static_gain_std_error = fit.static_gain_std_error;
  model.delay_std_error_s = fit.delay_std_error_s;
  model.misfit_per_freedom = std::sqrt(2 * fit.v / static_cast<double>(points));
  model.termination = fit.termination;
  model.steps = fit;
  return model;
}

/// Schwarz's criterion with the noise's size unknown.
double schwarz(double misfit, double values, double parameters) {
  return values * std::log(std::max(misfit, 1e-300) / values) + parameters * std::log(values);
}

/// Points of one group stay together; groups take turns.
std::vector<int> folds_of(const FrequencyResponse& response) {
  std::vector<int> folds;
  int rank = -1, group = std::numeric_limits<int>::min();
  for (const ResponsePoint& point : response.points) {
    if (point.group != group) ++rank;
    group = point.group;
    folds.push_back(rank % kFolds);
  }
  return folds;
}

FrequencyResponse part_of(const FrequencyResponse& response, const std::vector<int>& folds, int fold, bool judged) {
  FrequencyResponse part = response;
  part.points.clear();
  for (std::size_t k = 0; k < folds.size(); ++k) {
    if ((folds[k] == fold) == judged) part.points.push_back(response.points[k]);
  }
  return part;
}

class Chooser {
 public:
  Chooser(const FrequencyResponse& response, const ResponseOrderOptions& options)
      : response_(response), options_(options), folds_(folds_of(response)) {
    if (options.kind == ResponseModelKind::kAsymptotic) search_.emplace(response, largest_order());
  }

  /// The highest order that the points hold, and no higher than wanted.
  int largest_order() const {
    const auto values = static_cast<int>(response_.points.size()) * (rational() ? 2 : 1);
    const int supported = (values - 6) / 2;
    const int wanted = options_.order.value_or(options_.largest_order);
    return std::clamp(std::min(supported, wanted), 1, kMaxIdentifiedOrder);
  }

  Result<Scored> score(int order, int zeros) const {
    auto model = fit(order, zeros);
    if (!model) return tl::unexpected(model.error());
    Scored scored{.model = std::move(*model)};
    double squares = 0;
    for (int fold = 0; fold < kFolds; ++fold) {
      const FrequencyResponse judged = part_of(response_, folds_, fold, true);
      if (judged.points.empty()) continue;
      const TransferFunction g = refitted(scored.model, part_of(response_, folds_, fold, false), order, zeros);
      const auto at = sampled_response(g, judged);
      double error = 0;
      for (std::size_t k = 0; k < at.size(); ++k) {
        const ResponsePoint& p = judged.points[k];
        squares += std::norm(difference(p.gain, at[k]));
        error += rational() ? std::norm(p.gain - at[k]) / std::max(p.std_error * p.std_error, 1e-8 * std::norm(p.gain))
                            : std::pow(std::log(std::abs(p.gain) / std::abs(at[k])), 2);
      }
      scored.log_error.push_back(std::log(std::max(error, 1e-300)));
    }
    scored.line = {.order = order,
                   .zeros = zeros,
                   .delay_s = scored.model.transfer_function.delay_s,
                   .rmse_heldout = std::sqrt(squares / static_cast<double>(response_.points.size())),
                   .criterion = criterion(scored.model)};
    return scored;
  }

  /// BIC of a model fitted to all points.
  double criterion(const ResponseModel& model) const {
    const auto n = static_cast<double>(response_.points.size());
    const auto roots = static_cast<double>(model.transfer_function.poles.size() + model.transfer_function.zeros.size());
    if (!rational()) return schwarz(2 * model.steps->v, n, roots + 1);
    const double parameters = roots + 2;
    return schwarz(model.misfit_per_freedom * (2 * n - parameters), 2 * n, parameters);
  }

  double narrowest() const { return options_.order ? kNarrowestAskedFor : 1; }

  Result<ResponseModel> fit(int order, int zeros) const {
    if (!rational()) return model_of(search_->at(order, zeros), response_.points.size());
    auto fitted = fit_rational(response_, {.order = order, .zeros = zeros, .narrowest = narrowest()});
    if (!fitted) return tl::unexpected(fitted.error());
    return model_of(std::move(*fitted));
  }

  /// How many zeros an order begins with: as asked for, else one fewer than poles, or what BIC prefers where all are
  /// there already.
  int zeros_for(int order) const {
    if (options_.zeros) return std::min(*options_.zeros, order);
    if (rational()) return order - 1;
    int best = 0;
    for (int zeros = 1; zeros <= order; ++zeros) {
      if (criterion(*fit(order, zeros)) < criterion(*fit(order, best))) best = zeros;
    }
    return best;
  }

  bool rational() const { return options_.kind == ResponseModelKind::kRational; }

 private:
  Complex difference(Complex measured, Complex model) const {
    return rational() ? measured - model : Complex(std::abs(measured) - std::abs(model));
  }

  TransferFunction refitted(const ResponseModel& model, const FrequencyResponse& rest, int order, int zeros) const {
    if (!rational()) return refit_asymptotic(rest, *model.steps, kFoldIterations).transfer_function;
    RationalFitOptions options{.order = order, .zeros = zeros, .narrowest = narrowest()};
    options.starts = {model.transfer_function};
    options.only_given_starts = true;
    options.max_iterations = kFoldIterations;
    auto fitted = fit_rational(rest, options);
    return fitted ? fitted->transfer_function : model.transfer_function;
  }

  const FrequencyResponse& response_;
  ResponseOrderOptions options_;
  std::vector<int> folds_;
  std::optional<AsymptoteSearch> search_;
};

/// Standard error over folds of the difference of two scores.
double difference_error(const Scored& a, const Scored& b) {
  const auto n = static_cast<double>(a.log_error.size());
  const double mean = a.mean() - b.mean();
  double squares = 0;
  for (std::size_t i = 0; i < a.log_error.size(); ++i) {
    squares += std::pow(a.log_error[i] - b.log_error[i] - mean, 2);
  }
  return n > 1 ? std::sqrt(squares / (n - 1) / n) : 0;
}

std::size_t best_of(const std::vector<Scored>& scored) {
  const auto best = std::min_element(scored.begin(), scored.end(),
                                     [](const Scored& a, const Scored& b) { return a.mean() < b.mean(); });
  return static_cast<std::size_t>(best - scored.begin());
}

/// The order of lowest BIC.
std::size_t likeliest_of(const std::vector<Scored>& scored) {
  const auto lowest = std::min_element(scored.begin(), scored.end(), [](const Scored& a, const Scored& b) {
    return a.line.criterion < b.line.criterion;
  });
  return static_cast<std::size_t>(lowest - scored.begin());
}

/// The smallest order that predicts as well as the best.
std::size_t simplest_of(const std::vector<Scored>& scored) {
  const std::size_t best = best_of(scored);
  for (std::size_t i = 0; i < best; ++i) {
    const double worse = scored[i].mean() - scored[best].mean();
    if (worse < std::max(kIndifferent, difference_error(scored[i], scored[best]))) return i;
  }
  return best;
}

/// Zeros taken away one by one as long as BIC does not object.
Result<ResponseModel> with_fewest_zeros(const Chooser& chooser, ResponseModel model, int order, int zeros) {
  double criterion = chooser.criterion(model);
  for (int fewer = zeros - 1; fewer >= 0; --fewer) {
    auto smaller = chooser.fit(order, fewer);
    if (!smaller) return smaller;
    const double other = chooser.criterion(*smaller);
    if (other > criterion) break;
    criterion = other;
    model = std::move(*smaller);
  }
  return model;
}

std::string reason_for(const std::vector<Scored>& scored, std::size_t simplest, std::size_t likeliest) {
  const int best = scored[best_of(scored)].line.order;
  const int predicting = scored[simplest].line.order, likely = scored[likeliest].line.order;
  if (likely < predicting) {
    return fmt::format(
        "BIC is lowest at order {}; what order {} gains at held-out frequencies is not worth its parameters", likely,
        predicting);
  }
  if (predicting == best) {
    return fmt::format("order {} has the smallest error at held-out frequencies; BIC is lowest at order {}", best,
                       likely);
  }
  return fmt::format(
      "order {} is the smallest whose error at held-out frequencies is not worse than order {}'s by more than its "
      "scatter; BIC is lowest at order {}",
      predicting, best, likely);
}

void judge_order_asked_for(const std::vector<Scored>& scored, std::size_t supported, int order,
                           std::vector<std::string>& notes) {
  const Scored& own = scored[static_cast<std::size_t>(order - 1)];
  const Scored& enough = scored[supported];
  if (enough.line.order == order) return;
  if (enough.line.order > order) {
    notes.push_back(fmt::format("order {} leaves something: held-out error {:.4g} against {:.4g} at order {}", order,
                                own.line.rmse_heldout, enough.line.rmse_heldout, enough.line.order));
    return;
  }
  notes.push_back(
      fmt::format("the data do not support order {}: order {} predicts held-out frequencies as well "
                  "({:.4g} against {:.4g}){}",
                  order, enough.line.order, enough.line.rmse_heldout, own.line.rmse_heldout,
                  own.line.criterion > enough.line.criterion ? ", and BIC prefers it" : ""));
}

}  // namespace

Result<ResponseOrderChoice> choose_response_order(const FrequencyResponse& response,
                                                  const ResponseOrderOptions& options) {
  const bool rational = options.kind == ResponseModelKind::kRational;
  if (options.order) {
    const int zeros = options.zeros.value_or(0);
    const auto parameters = static_cast<std::size_t>(*options.order + zeros);
    if (*options.order < 1 || *options.order > kMaxIdentifiedOrder || zeros < 0 || zeros > *options.order) {
      return fail("bad_option", fmt::format("order must be from 1 to {} with no more zeros than poles, not {} and {}",
                                            kMaxIdentifiedOrder, *options.order, zeros));
    }
    if (response.points.size() * (rational ? 2 : 1) < 2 * parameters + 6) {
      return fail("too_few_points", fmt::format("order {} is not supported by {} usable frequencies", *options.order,
                                                response.points.size()));
    }
  }
  const Chooser chooser(response, options);
  std::vector<Scored> scored;
  for (int order = 1; order <= chooser.largest_order(); ++order) {
    auto one = chooser.score(order, chooser.zeros_for(order));
    if (!one) return tl::unexpected(one.error());
    scored.push_back(std::move(*one));
  }
  const std::size_t simplest = simplest_of(scored), likeliest = likeliest_of(scored);
  const std::size_t supported = std::min(simplest, likeliest);
  ResponseOrderChoice choice;
  std::size_t taken = supported;
  if (options.order && static_cast<std::size_t>(*options.order) <= scored.size()) {
    taken = static_cast<std::size_t>(*options.order - 1);
    choice.reason = "as asked for";
    judge_order_asked_for(scored, supported, *options.order, choice.notes);
  } else {
    choice.reason = reason_for(scored, simplest, likeliest);
  }
  for (const Scored& one : scored) choice.tried.push_back(one.line);
  choice.model = std::move(scored[taken].model);
  if (!options.zeros && rational) {
    const TriedResponseOrder& line = choice.tried[taken];
    auto smaller = with_fewest_zeros(chooser, std::move(choice.model), line.order, line.zeros);
    if (!smaller) return tl::unexpected(smaller.error());
    choice.model = std::move(*smaller);
  }
  return choice;
}

}  // namespace valvetriage
