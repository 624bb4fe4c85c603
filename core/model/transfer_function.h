#pragma once

#include <complex>
#include <cstdint>
#include <span>
#include <vector>

#include "core/result.h"

namespace valvetriage {

enum class Domain : std::uint8_t { kS, kZ };

/// A rational transfer function by its roots.
///
///   s:  G(s) = gain ∏(s − zeros[i]) / ∏(s − poles[j]) e^(−s delay_s)                          roots in rad/s
///   z:  G(z) = gain ∏(z − zeros[i]) / ∏(z − poles[j]) z^(−delay_s / sample_time_s)            delay a whole number of
///   samples
///
/// Complex roots come in conjugate pairs. Order = number of poles.
struct TransferFunction {
  Domain domain = Domain::kZ;
  double sample_time_s = 0;  ///< 0 in the s domain
  std::vector<std::complex<double>> zeros{};
  std::vector<std::complex<double>> poles{};
  double gain = 1;
  double delay_s = 0;
};

/// No recording has as many samples: a longer delay is one of as many.
inline constexpr double kMostDelaySamples = 1e9;

/// The same as coefficients. z: powers of z^-1, y_t = Σ b_i u_{t-delay-i} − Σ_{j≥1} a_j y_{t-j}, a[0] = 1.
/// s: descending powers of s, a[0] = 1.
struct RationalCoefficients {
  Domain domain = Domain::kZ;
  double sample_time_s = 0;
  std::vector<double> b{};
  std::vector<double> a{};
  int delay_samples = 0;  ///< z domain
  double delay_s = 0;     ///< s domain
};

/// Roots to coefficients and back. Errors: not_finite, leading_zero, improper,
/// fractional_delay.
Result<RationalCoefficients> to_coefficients(const TransferFunction& g);
Result<TransferFunction> to_transfer_function(const RationalCoefficients& c);

/// Poles inside the unit circle (z) or the left half plane (s), strictly.
bool is_stable(const TransferFunction& g);

/// Gain at rest: G(1) or G(0); infinite with a pole there.
double static_gain(const TransferFunction& g);

/// Complex response at each frequency [Hz], delay included.
std::vector<std::complex<double>> frequency_response(const TransferFunction& g, std::span<const double> frequency_hz);

/// Zero-order-hold equivalent of a continuous system at a sample time; the delay's fraction of a sample is kept exactly
/// (modified z-transform). Errors: not stable is no error; improper, sample time not positive are.
Result<TransferFunction> discretise_zoh(const TransferFunction& continuous, double sample_time_s);
/// Triangle-hold (first-order-hold) equivalent: exact for inputs that are linear between samples. As discretise_zoh.
Result<TransferFunction> discretise_foh(const TransferFunction& continuous, double sample_time_s);
/// The continuous system whose zero-order-hold equivalent this is. Errors: no_continuous_equivalent for a
/// pole on the non-positive real axis.
Result<TransferFunction> continuous_from_zoh(const TransferFunction& discrete);

/// What a unit step does: 10-90 % rise time, 2 % settling time, overshoot ratio (of the final value). Settling
/// counts from the step, delay included. Errors: unstable; no_static_gain; too_slow for a discrete model whose response
/// takes more than 12 million samples.
struct StepMetrics {
  double rise_time_s = 0;
  double settling_time_s = 0;
  double overshoot_ratio = 0;
};
Result<StepMetrics> step_metrics(const TransferFunction& g);

}  // namespace valvetriage
