#include "core/identify/rls.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

namespace valvetriage {
namespace {

/// Growth of P over P(0) beyond which nothing more is forgotten: a stream at rest would otherwise overflow P.
constexpr double kWindUp = 1e12;

std::size_t parameter_count(const RlsOptions& o) {
  const int extra = o.form == RlsForm::kExtended ? o.noise_terms : (o.form == RlsForm::kAbsolute ? 1 : 0);
  return static_cast<std::size_t>(o.order + o.input_terms + extra);
}

/// Updates between two looks at P's size: even λ = 0.01 grows P by no more than 10¹²⁸ in between.
constexpr std::size_t kWindUpPeriod = 64;

/// Columns are padded with a zero to pairs of doubles, so that both lanes are used; the pad of column j meets φⱼ.
constexpr std::size_t padded(std::size_t n) {
  return (n + 1) & ~std::size_t{1};
}

/// The newest value to the front, the oldest dropped.
void push_front(std::vector<double>& history, double value) {
  std::copy_backward(history.begin(), history.end() - 1, history.end());
  history.front() = value;
}

Error bad_option(const char* field, std::string expected, std::string found) {
  Error error{.code = "bad_option", .message = fmt::format("{} must be {}, not {}", field, expected, found)};
  error.field = field;
  error.expected = std::move(expected);
  error.found = std::move(found);
  return error;
}

Result<void> check_count(const char* field, int value, int least, int most) {
  if (value >= least && value <= most) return {};
  return tl::unexpected(
      bad_option(field, fmt::format("a whole number from {} to {}", least, most), fmt::to_string(value)));
}

}  // namespace

RlsKernel::RlsKernel(std::vector<double> theta, double lambda, double initial_covariance)
    : n_(theta.size()),
      theta_(std::move(theta)),
      diagonal_(n_, initial_covariance),
      f_(n_),
      inverse_alpha_(n_ + 1),
      k_(n_),
      lambda_(lambda),
      largest_trace_(kWindUp * initial_covariance * static_cast<double>(n_)) {
  std::size_t entries = 0;
  for (std::size_t j = 0; j < n_; ++j) entries += padded(j);
  columns_.resize(entries);
}

void RlsKernel::look_for_wind_up() {
  double trace = 0;
  const double* column = columns_.data();
  for (std::size_t j = 0; j < n_; ++j) {
    double squares = 1;
    for (std::size_t i = 0; i < j; ++i) squares += column[i] * column[i];
    trace += diagonal_[j] * squares;
    column += padded(j);
  }
  wound_up_ = trace > largest_trace_;
}

Result<double> RlsKernel::update(std::span<const double> phi, double y) {
  if (phi.size() != n_) {
    return fail("wrong_size", fmt::format("the regressor has {} values, the estimate {}", phi.size(), n_));
  }
  if (lambda_ < 1 && updates_ % kWindUpPeriod == 0) look_for_wind_up();

  double predicted = 0;
  double alpha = lambda_;
  const double* column = columns_.data();
  for (std::size_t j = 0; j < n_; ++j) {
    double even = phi[j];
    double odd = 0;  // two sums, so that the compiler may use both lanes
    for (std::size_t i = 0; i < j; i += 2) {
      even += column[i] * phi[i];
      odd += column[i + 1] * phi[i + 1];
    }
    column += padded(j);
    f_[j] = even + odd;
    predicted += phi[j] * theta_[j];
    inverse_alpha_[j] = 1 / alpha;
    alpha += f_[j] * f_[j] * diagonal_[j];
  }
  inverse_alpha_[n_] = 1 / alpha;
  const double error = y - predicted;
  const double squared = error * error * inverse_alpha_[n_];
  if (!std::isfinite(squared) || !std::isfinite(alpha)) {
    return fail("not_finite", "the sample is not finite or too large to be used; the estimate is unchanged");
  }

  update_covariance();
  const double step = error * inverse_alpha_[n_];
  for (std::size_t j = 0; j < n_; ++j) theta_[j] += k_[j] * step;
  squared_error_ = lambda_ * (squared_error_ + squared);
  effective_samples_ = lambda_ * effective_samples_ + 1;
  ++updates_;
  return error;
}

void RlsKernel::update_covariance() {
  double* const k = k_.data();
  const double growth = wound_up_ ? 1 : 1 / lambda_;
  double alpha = lambda_;
  struct Gain {
    double v, down;
  };
  const auto shrink_diagonal = [&](std::size_t j) {
    const Gain gain{f_[j] * diagonal_[j], f_[j] * inverse_alpha_[j]};
    diagonal_[j] *= alpha * inverse_alpha_[j + 1] * growth;
    alpha += f_[j] * gain.v;
    return gain;
  };
  // Two columns at a time, so that k goes through memory half as often. The first column has nothing above its
  // diagonal.
  if (n_ % 2 == 1) k[0] = shrink_diagonal(0).v;
  double* left = columns_.data();
  for (std::size_t j = n_ % 2; j < n_; j += 2) {
    double* const right = left + padded(j);
    const Gain of_left = shrink_diagonal(j);
    const Gain of_right = shrink_diagonal(j + 1);
    for (std::size_t i = 0; i < j; ++i) {
      const double old_left = left[i], old_right = right[i];
      const double between = k[i] + old_left * of_left.v;
      left[i] = old_left - k[i] * of_left.down;
      right[i] = old_right - between * of_right.down;
      k[i] = between + old_right * of_right.v;
    }
    k[j] = of_left.v + right[j] * of_right.v;
    k[j + 1] = of_right.v;
    right[j] -= of_left.v * of_right.down;
    left = right + padded(j + 1);
  }
}

Eigen::MatrixXd RlsKernel::covariance() const {
  const auto size = static_cast<Eigen::Index>(n_);
  Eigen::MatrixXd upper = Eigen::MatrixXd::Identity(size, size);
  const double* column = columns_.data();
  for (std::size_t j = 0; j < n_; ++j) {
    for (std::size_t i = 0; i < j; ++i) upper(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = column[i];
    column += padded(j);
  }
  return upper * Eigen::Map<const Eigen::VectorXd>(diagonal_.data(), size).asDiagonal() * upper.transpose();
}

double RlsKernel::noise_variance() const {
  const double freedom = effective_samples_ - static_cast<double>(n_);
  return freedom > 0 ? squared_error_ / freedom : std::numeric_limits<double>::infinity();
}

Result<RecursiveLeastSquares> RecursiveLeastSquares::create(const RlsOptions& options) {
  const int least_noise_terms = options.form == RlsForm::kExtended ? 1 : 0;
  for (const auto& checked : {check_count("order", options.order, 1, kMaxRlsTerms),
                              check_count("input_terms", options.input_terms, 1, kMaxRlsTerms),
                              check_count("noise_terms", options.noise_terms, least_noise_terms, kMaxRlsTerms),
                              check_count("delay_samples", options.delay_samples, 0, kMaxRlsDelay)}) {
    if (!checked) return tl::unexpected(checked.error());
  }
  if (!(options.lambda > 0 && options.lambda <= 1)) {
    return tl::unexpected(bad_option("lambda", "above 0 and at most 1", fmt::to_string(options.lambda)));
  }
  if (!(options.initial_covariance > 0 && std::isfinite(options.initial_covariance))) {
    return tl::unexpected(bad_option("initial_covariance", "positive", fmt::to_string(options.initial_covariance)));
  }
  const std::size_t n = parameter_count(options);
  if (!options.initial_estimate.empty() && options.initial_estimate.size() != n) {
    return tl::unexpected(bad_option("initial_estimate", fmt::format("empty or {} values", n),
                                     fmt::format("{} values", options.initial_estimate.size())));
  }
  if (!std::all_of(options.initial_estimate.begin(), options.initial_estimate.end(),
                   [](double value) { return std::isfinite(value); })) {
    return tl::unexpected(bad_option("initial_estimate", "finite", "a value that is not"));
  }
  return RecursiveLeastSquares(options);
}

RecursiveLeastSquares::RecursiveLeastSquares(const RlsOptions& options)
    : options_(options),
      kernel_(
          options.initial_estimate.empty() ? std::vector<double>(parameter_count(options)) : options.initial_estimate,
          options.lambda, options.initial_covariance),
      inputs_(static_cast<std::size_t>(options.delay_samples + options.input_terms)),
      outputs_(static_cast<std::size_t>(options.order)),
      noise_(options.form == RlsForm::kExtended ? static_cast<std::size_t>(options.noise_terms) : 0),
      phi_(parameter_count(options)) {}

Result<void> RecursiveLeastSquares::update(double input, double output) {
  if (!std::isfinite(input) || !std::isfinite(output)) {
    return fail("not_finite",
                fmt::format("the sample ({}, {}) is not finite; the estimate is unchanged", input, output));
  }
  const bool increments = options_.form != RlsForm::kAbsolute;
  const std::size_t lags_filled = seen_ - (increments && seen_ > 0 ? 1 : 0);  // Δ of the first sample does not exist
  const bool ready = lags_filled >= std::max(outputs_.size(), inputs_.size() - 1) && (!increments || seen_ > 0);
  const double new_input = increments ? input - last_input_ : input;
  const double new_output = increments ? output - last_output_ : output;

  if (ready) {
    auto entry = std::transform(outputs_.begin(), outputs_.end(), phi_.begin(), [](double y) { return -y; });
    // u(t) is the newest and not yet in the history.
    for (int i = 0; i < options_.input_terms; ++i) {
      const int lag = options_.delay_samples + i;
      *entry++ = lag == 0 ? new_input : inputs_[static_cast<std::size_t>(lag - 1)];
    }
    entry = std::copy(noise_.begin(), noise_.end(), entry);
    if (!increments) *entry = 1;
    const Result<double> error = kernel_.update(phi_, new_output);
    if (!error) return tl::unexpected(error.error());
    prediction_error_ = *error;
    if (!noise_.empty()) {
      const auto theta = kernel_.theta_hat();
      double fitted = 0;
      for (std::size_t i = 0; i < phi_.size(); ++i) fitted += theta[i] * phi_[i];
      push_front(noise_, new_output - fitted);
    }
  }
  if (!increments || seen_ > 0) {
    push_front(inputs_, new_input);
    push_front(outputs_, new_output);
  }
  last_input_ = input;
  last_output_ = output;
  ++seen_;
  return {};
}

void RecursiveLeastSquares::forget_past() {
  seen_ = 0;
  std::fill(noise_.begin(), noise_.end(), 0.0);
}

std::vector<std::string> RecursiveLeastSquares::parameter_names() const {
  std::vector<std::string> names;
  for (int i = 1; i <= options_.order; ++i) names.push_back(fmt::format("a{}", i));
  for (int i = 0; i < options_.input_terms; ++i) names.push_back(fmt::format("b{}", i));
  for (std::size_t i = 1; i <= noise_.size(); ++i) names.push_back(fmt::format("c{}", i));
  if (options_.form == RlsForm::kAbsolute) names.emplace_back("offset");
  return names;
}

RationalCoefficients RecursiveLeastSquares::coefficients(double sample_time_s) const {
  const auto theta = theta_hat();
  RationalCoefficients result;
  result.domain = Domain::kZ;
  result.sample_time_s = sample_time_s;
  result.delay_samples = options_.delay_samples;
  result.a.assign(1, 1.0);
  result.a.insert(result.a.end(), theta.begin(), theta.begin() + options_.order);
  result.b.assign(theta.begin() + options_.order, theta.begin() + options_.order + options_.input_terms);
  return result;
}

}  // namespace valvetriage
