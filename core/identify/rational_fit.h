#pragma once

#include <span>
#include <vector>

#include "core/identify/frequency_response.h"
#include "core/identify/output_error.h"

namespace valvetriage {

struct RationalFitOptions {
  int order = 2;                           ///< poles, 1 to kMaxIdentifiedOrder
  int zeros = 1;                           ///< 0 to order
  bool fit_delay = true;                   ///< else 0
  int max_iterations = 60;                 ///< of the refinement
  double narrowest = 1;                    ///< half-power width of a resonance, over the points' distance there
  std::vector<TransferFunction> starts{};  ///< further starting points: their poles and delay
  bool only_given_starts = false;          ///< no search of its own: refits from a near optimum
};

/// A rational transfer function fitted to a complex response.
///
/// Errors of roots are √E|δ root|², rad/s; infinite where a root repeats. Errors are scaled by the misfit where it is
/// larger than the noise explains.
struct RationalFit {
  TransferFunction transfer_function;                    ///< s domain
  std::vector<double> pole_std_errors, zero_std_errors;  ///< in the order of the roots [rad/s]
  double static_gain = 0, static_gain_std_error = 0;
  double delay_std_error_s = 0;
  std::vector<double> response_std_error;  ///< √E|δG|² at the fitted points
  double chi_square = 0;                   ///< Σ 2 |H − G|² / σ²: 2 points − parameters expected
  double misfit_per_freedom = 0;           ///< chi_square over its freedoms
  int parameters = 0;
  int iterations = 0;
  Termination termination = Termination::kConverged;
};

/// Maximum likelihood for a response with independent circular normal errors of the measured variances:
///
///   argmin Σ_k |H_k − G_k|² / σ_k²      G(s) = Σ c_i N_i(s) / ∏ (s² + a_1 s + a_0) · e^(−sτ)
///
/// a_1, a_0 = e^…: poles have negative real parts whatever the data say, coefficients are real, pairs complex or real;
/// no resonance is narrower than `narrowest` times the points' distance (a_1 ≥ narrowest Δω). τ ≥ 0. N_i =
/// ∏_{j≤i} (s/ν_j + 1), ν_j spread over the band, is well conditioned at order nine. σ comes from the residual of each
/// window, which is what coherence measures: σ² = |G|² (1 − γ²) / (γ² freedoms).
///
/// Starts: relaxed vector fitting (Gustavsen and Semlyen 1999, Gustavsen 2006) with its poles reflected into the left
/// half plane, at five delays between none and all of the phase. Then Levenberg-Marquardt with analytic sensitivities.
/// Where the response was sampled, the model is compared with the images that sampling folds in:
/// Σ_l G(f + l/T) hold(f + l/T) / hold(f).
///
/// Errors  `bad_option`; `too_few_points`: two more real values than parameters at least
/// Cost    order 9 at 200 frequencies: some 50 ms; pure
Result<RationalFit> fit_rational(const FrequencyResponse& response, const RationalFitOptions& options);

/// What a model shows at the response's points, images included.
std::vector<std::complex<double>> sampled_response(const TransferFunction& g, const FrequencyResponse& response);

/// Poles by relaxed vector fitting: stable, conjugate pairs exact. A starting point, and a method of its own.
///
/// delay_s   taken off the response first
/// proper    with a direct term (as many zeros as poles) or without
std::vector<std::complex<double>> vector_fitting_poles(std::span<const ResponsePoint> points, int order, bool proper,
                                                       double delay_s, int iterations);

}  // namespace valvetriage
