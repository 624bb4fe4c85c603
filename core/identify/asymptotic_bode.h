#pragma once

#include <span>
#include <vector>

#include "core/identify/frequency_response.h"
#include "core/identify/output_error.h"

namespace valvetriage {

struct AsymptoticFitOptions {
  int poles = 2;  ///< 1 to kMaxIdentifiedOrder
  int zeros = 0;  ///< 0 to poles
};

/// A breakpoint of the asymptote: x_i = ln of a corner [rad/s], t_i = 1 for a pole and −1 for a zero.
struct Breakpoint {
  double x = 0;
  double t = 1;
};

/// What Santos and Carvalho's method gives, step by step.
struct AsymptoticFit {
  TransferFunction transfer_function;                    ///< real poles and zeros in the left half plane
  std::vector<double> pole_std_errors, zero_std_errors;  ///< rad/s
  double static_gain = 0, static_gain_std_error = 0;
  double delay_std_error_s = 0;
  std::vector<Breakpoint> asymptote;  ///< minimum of J, by rising x
  double asymptote_log_gain = 0;      ///< ln of its gain left of all breakpoints
  double j = 0;                       ///< Eq 6 at its minimum [neper² e-folds]
  double v_start = 0;                 ///< Eq 1 at the asymptote's breakpoints [neper²]
  double v = 0;                       ///< Eq 1 at its minimum [neper²]
  int parameters = 0;
  int iterations = 0;
  Termination termination = Termination::kConverged;
};

/// Every model with up to so many poles and zeros, built up by one breakpoint at a time.
///
/// Step 1, the asymptote (paper Eqs 4 to 6), J the integral by trapezoids over the measured x = ln ω:
///
///   J = ½ ∫ (Lm Y − assy)² dx,    assy = g + Σ −t_i max(0, x − x_i)
///
/// Away from the breakpoints J is a parabola in each x_i; one breakpoint, or a pole and a zero side by side, is added
/// at each of a grid of places and all are refined by Levenberg-Marquardt. Which are poles and which zeros is tried
/// every way: the model with p poles and z zeros grows from those with a pole, a zero or one of each less.
///
/// Step 2, the curve itself (paper Eqs 1 and 3 in corner form), from that start:
///
///   V = ½ Σ_k (ln|Y_k| − ln|B/A|)²,    ln|B/A| = g − Σ t_i ½ ln(1 + e^(2 (x − x_i)))
///
/// and from the smaller models' own minima of V, where the corners lie too close for their asymptote to show them; the
/// lower V is kept.
///
/// Step 3, what Eq 2 leaves out: the sign of the gain and the delay, from the phase that the minimum-phase model does
/// not explain, weighted by its standard errors. All steps see gains only where the response is usable; as printed, V
/// weighs every frequency alike.
class AsymptoteSearch {
 public:
  /// most_poles  1 to kMaxIdentifiedOrder; zeros up to as many as poles
  AsymptoteSearch(const FrequencyResponse& response, int most_poles);
  /// The model with this many of each; poles ≤ most_poles, zeros ≤ poles.
  const AsymptoticFit& at(int poles, int zeros) const;

 private:
  int most_poles_;
  std::vector<AsymptoticFit> fits_;  ///< row by row, poles × zeros
};

/// Santos and Carvalho's estimate as the paper uses it, for given numbers of poles and zeros.
///
/// Errors  `bad_option`; `too_few_points`: fewer than two more points than parameters
/// Cost    all smaller models: order 9 at 200 frequencies some 0.2 s; pure
Result<AsymptoticFit> fit_asymptotic(const FrequencyResponse& response, const AsymptoticFitOptions& options);

/// Step 2 and 3 alone, from given breakpoints: refits on a part of the points.
AsymptoticFit refit_asymptotic(const FrequencyResponse& response, const AsymptoticFit& start, int max_iterations);

/// ln|B/A| at x without the gain (Eq 3 in corner form), and the asymptote of Eq 4.
double log_gain(std::span<const Breakpoint> breakpoints, double x);
double asymptote_log_gain(std::span<const Breakpoint> breakpoints, double x);

}  // namespace valvetriage
