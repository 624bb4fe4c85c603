#pragma once

#include <complex>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/model/transfer_function.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// How the input goes between its samples: what a measured ratio of spectra must be corrected for.
///
/// kLinear  straight from sample to sample: factor sinc²(f T)
/// kHeld    constant until the next sample: factor sinc(f T) e^(−jπ f T)
enum class Hold : std::uint8_t { kLinear, kHeld };

/// Y/U in samples over G(j2πf), images left out. 1 at f = 0.
std::complex<double> hold_factor(Hold hold, double frequency_hz, double sample_period_s);

enum class ResponseMethod : std::uint8_t { kLocalPolynomial, kPeriods };
std::string to_string(ResponseMethod method);

/// The response at one frequency.
///
/// std_error  of the complex gain, rms: √E|Ĝ − G|², noise and stochastic nonlinear distortion together
struct ResponsePoint {
  double frequency_hz = 0;
  std::complex<double> gain;  ///< unit of the output per unit of the input
  double std_error = 0;
  double coherence = 0;           ///< share of the output's power here that the input explains, 0 to 1
  double degrees_of_freedom = 0;  ///< complex ones that std_error rests on
  int group = 0;                  ///< points of one group come from the same lines
};

/// A band without a response, and why: `not_excited`, `low_coherence`, `clipped`.
struct UnusableBand {
  double from_hz = 0;
  double to_hz = 0;
  std::string reason;
};

/// Rms of the output per line, at lines of a periodic input that was left out of some of them.
struct DistortionLines {
  std::vector<double> frequency_hz;
  std::vector<double> level;  ///< unit of the output
};

/// How nonlinear, and how (Pintelon and Schoukens, System Identification, 2012, section 4.3).
///
/// Excited odd lines carry the best linear approximation. What stands in odd lines that were left empty comes from odd
/// nonlinearity (saturation, friction), what stands in even ones from even nonlinearity (a bent map); noise from the
/// differences between periods. Ratios are of rms per line to the rms of the excited lines.
struct Distortion {
  DistortionLines linear, noise, odd, even;
  double noise_ratio = 0, odd_ratio = 0, even_ratio = 0;
};

struct FrequencyResponse {
  ResponseMethod method = ResponseMethod::kLocalPolynomial;
  Hold hold = Hold::kLinear;
  double sample_period_s = 0;
  std::vector<ResponsePoint> points;  ///< rising frequency
  std::vector<UnusableBand> unusable;
  std::optional<Distortion> distortion;  ///< where lines were left empty
  double input_mean = 0;                 ///< operating point, unit of the input
  double input_amplitude = 0;            ///< half of the input's range (1 % cut off either end)
  int repeats = 0;                       ///< recordings
  int periods = 0;                       ///< of each; 0 where the input is not periodic
};

struct FrequencyResponseOptions {
  double least_coherence = 0.8;  ///< below, half of what the output does has another cause
  int points_per_decade = 40;    ///< where the record is long enough
};

/// Fewest points that make a frequency response.
inline constexpr std::size_t kFewestResponsePoints = 8;

/// Gain, phase, coherence and standard error of a plant over frequency.
///
/// Any excitation: local polynomials (Schoukens, Vandersteen, Barbé and Pintelon, IEEE Trans. IM 58, 2009). Within a
/// window of lines
///
///   Y_k = G(f_k) U_k + T(f_k) + V_k,   G and T parabolas in f
///
/// by least squares: T takes the transient of a record that does not begin and end at rest, each repeat its own, so
/// that no window function is needed. The parabola is read at its three Gauss-Legendre nodes, where the estimates of
/// one window are uncorrelated: three points carry all that the window knows. Windows do not overlap; they are at least
/// 12 lines wide and grow with frequency. The standard error comes from the window's own residual.
///
/// Where a parabola leaves much and a rational function of second order, Y D = N U + T with D = 1 + d_1 x + d_2 x²
/// (McKelvey and Guérin, SYSID 2012), leaves less than half, the window holds a resonance and is read from that, at
/// five nodes.
///
/// Periodic input (two periods or more): the excited lines one by one; transient and noise from the lines between
/// harmonics, distortion from harmonics left empty; the standard error holds both.
///
/// A window is not excited where its input's power is below a hundred-thousandth of the strongest's, or as smooth over
/// frequency as a transient (beyond the end of a sweep). A response at 0.45 of the sampling
/// rate and above is not estimated.
///
/// repeats   recordings of one test at one amplitude and operating point, the same sampling rate; samples that are not
///           valid count as interpolated, a record with more than 2 % of them is cut to its longest valid part
/// Errors    `too_short`, `clipped`, `not_excited`, `low_coherence`: fewer than eight usable points; the message names
///           the frequencies that are usable. `sample_time_differs`, `no_samples`
/// Cost      O(n log n) for every length; pure
Result<FrequencyResponse> estimate_frequency_response(std::span<const Recording* const> repeats,
                                                      const FrequencyResponseOptions& options = {});

/// Period of an input in samples: the smallest lag after which it repeats within 2 % of its power, at least twice in
/// the record; 0 where there is none. Cost O(n log n).
std::size_t period_of(std::span<const double> input);

/// Gain over its value at the lowest frequency, as the paper plots it.
std::vector<double> normalised_gain(std::span<const ResponsePoint> points);
/// Phase in degrees, continuous from point to point, the first in (−180, 180].
std::vector<double> unwrapped_phase_deg(std::span<const ResponsePoint> points);
/// Half width of a 95 % band of |G| at one point: the real part of a complex normal error with F-distributed scale.
double gain_half_width95(const ResponsePoint& point);

/// Gain dependent on amplitude: two responses at the frequencies they share, relative to the smaller amplitude's.
///
/// change_rms   rms of |G_2 − G_1| / |G_1| beyond what the standard errors explain (0 at least)
/// expected     the rms that the standard errors alone give
/// p_value      of Σ |G_2 − G_1|² / (σ_1² + σ_2²) under a linear plant (χ² with 2 per point, F with the fewest degrees
///              of freedom)
struct AmplitudeDependence {
  double amplitude_low = 0, amplitude_high = 0;
  double change_rms = 0;
  double expected = 0;
  double p_value = 1;
  std::size_t points = 0;
};
/// Empty where fewer than four frequencies are shared.
std::optional<AmplitudeDependence> compare_amplitudes(const FrequencyResponse& low, const FrequencyResponse& high);

}  // namespace valvetriage
