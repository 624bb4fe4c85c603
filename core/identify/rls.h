#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/model/transfer_function.h"
#include "core/result.h"

namespace valvetriage {

/// What the recursion sees.
///
/// kIncremental  increments of input and output, ĉ₁ = 0: the paper's Eq 8. Biased in measurement noise, because
///               differencing makes white noise a moving average with a unit root.
/// kExtended     increments with the noise terms of Eq 7: ξ is replaced by the residual after the update (extended
/// least
///               squares). Removes part of that bias.
/// kAbsolute     levels with a constant term, y = −Σ a y + Σ b u + offset.
enum class RlsForm : std::uint8_t { kIncremental, kExtended, kAbsolute };

/// Settings of a recursion. Defaults: the paper's form, nothing forgotten, a start that the data soon overrule.
struct RlsOptions {
  RlsForm form = RlsForm::kIncremental;
  int order = 2;                           ///< n_a, number of a, 1 to kMaxRlsTerms
  int input_terms = 3;                     ///< number of b (b₀, b₁, …), 1 to kMaxRlsTerms
  int noise_terms = 1;                     ///< number of c in the extended form; Eq 7 has one
  int delay_samples = 0;                   ///< k, 0 to kMaxRlsDelay
  double lambda = 1;                       ///< forgetting factor, 0 < λ ≤ 1; 1 forgets nothing
  double initial_covariance = 1e6;         ///< P(0) = this times the identity
  std::vector<double> initial_estimate{};  ///< θ̂(0), or empty for zeros
};

inline constexpr int kMaxRlsTerms = 32;     ///< of each kind: far beyond the order of any valve (5 to 9 in the paper)
inline constexpr int kMaxRlsDelay = 10000;  ///< samples kept of the input's past

/// One recursive least-squares update (paper Eqs 13 to 15) with P = U D Uᵀ: U unit upper triangular, D diagonal
/// (Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chapter V).
///
///   f = Uᵀ φ    v = D f    α₀ = λ    αⱼ = αⱼ₋₁ + fⱼ vⱼ
///   for every column j:   Uⱼ ← Uⱼ − k fⱼ / αⱼ₋₁    k ← k + Uⱼ vⱼ (the old Uⱼ)    dⱼ ← dⱼ αⱼ₋₁ / (αⱼ λ)
///   K = k / αₙ    θ ← θ + K ε
///
/// The product U D Uᵀ equals Eq 15 and, unlike Eq 15 in floating point, cannot lose symmetry or become indefinite.
/// Forgetting pauses while P is 10¹² times P(0): a stream at rest tells nothing and must not overflow.
class RlsKernel {
 public:
  /// n parameters, P(0) = initial_covariance · I
  RlsKernel(std::vector<double> theta, double lambda, double initial_covariance);

  /// phi  n values; y  one output (or increment)
  /// returns the prediction error ε = y − φᵀ θ before the update
  /// Errors  not_finite if phi or y is NaN or infinite, or the update would overflow; the state is unchanged
  /// Cost    1.5 n² multiplications, n divisions, no allocation; one object, one thread
  Result<double> update(std::span<const double> phi, double y);

  std::span<const double> theta_hat() const { return {theta_.data(), n_}; }
  /// P, n × n: parameter covariance over the noise variance.
  Eigen::MatrixXd covariance() const;
  /// Exponentially weighted noise variance, from ε² λ / α; infinite until there are more updates than parameters.
  double noise_variance() const;
  std::size_t updates() const { return updates_; }

 private:
  /// U, D and k from f and 1/α.
  void update_covariance();
  /// Whether P is still of a size to grow.
  void look_for_wind_up();

  std::size_t n_;
  std::vector<double> theta_;
  std::vector<double> columns_;  // U above its diagonal, column after column, each padded with a zero to an even length
  std::vector<double> diagonal_;               // D
  std::vector<double> f_, inverse_alpha_, k_;  // scratch; α₀ is the first of n + 1
  double lambda_;
  double largest_trace_;
  bool wound_up_ = false;
  double squared_error_ = 0;
  double effective_samples_ = 0;
  std::size_t updates_ = 0;
};

/// Recursive least squares sample by sample on a live stream (paper Eqs 7 to 15).
///
///   ψ = [−Δy(t−1) … −Δy(t−n_a), Δu(t−k) … Δu(t−k−n_b+1)]          kIncremental
///   ψ = [the same, ξ̂(t−1) … ξ̂(t−n_c)]                              kExtended
///   ψ = [−y(t−1) …, u(t−k) …, 1]                                   kAbsolute
///
/// The first samples fill the regressor and change no estimate.
class RecursiveLeastSquares {
 public:
  /// Errors  bad_option with the field's name
  static Result<RecursiveLeastSquares> create(const RlsOptions& options);

  /// One sample. Errors: not_finite; the state is unchanged. Cost: O(n²), no allocation.
  Result<void> update(double input, double output);
  /// The regressor starts anew (a gap, another recording); the estimate and P stay.
  void forget_past();

  /// a₁ … a_na, b₀ …, then c₁ … (extended) or the offset (absolute)
  std::span<const double> theta_hat() const { return kernel_.theta_hat(); }
  Eigen::MatrixXd covariance() const { return kernel_.covariance(); }
  double noise_variance() const { return kernel_.noise_variance(); }
  double prediction_error() const { return prediction_error_; }
  std::size_t updates() const { return kernel_.updates(); }
  const RlsOptions& options() const { return options_; }
  /// Names of theta_hat's entries: "a1", "b0", "c1", "offset".
  std::vector<std::string> parameter_names() const;
  /// The transfer function's coefficients without noise terms and offset.
  RationalCoefficients coefficients(double sample_time_s) const;

 private:
  explicit RecursiveLeastSquares(const RlsOptions& options);

  RlsOptions options_;
  RlsKernel kernel_;
  std::vector<double> inputs_;   // newest first: increments or levels, delay + n_b values
  std::vector<double> outputs_;  // newest first: n_a values, before the current one
  std::vector<double> noise_;    // newest first: n_c residuals
  std::vector<double> phi_;
  std::size_t seen_ = 0;
  double last_input_ = 0;
  double last_output_ = 0;
  double prediction_error_ = 0;
};

}  // namespace valvetriage
