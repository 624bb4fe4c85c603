#pragma once

#include <vector>

#include "core/model/transfer_function.h"

namespace valvetriage {

/// The four transfer functions that the paper prints, kept as data.

/// Eqs 16 (good valve) and 17 (returned valve), with the misprint s²/(8.5 s²) read as s²/8.5².
///
///   G(s) = k (s/z + 1) (s²/w² + 2 ζ_z s/w + 1)² / ((s/p + 1) (s²/w² + 2 ζ_p s/w + 1)² (s/10 + 1)^m)
///
/// static gain 1: k_dc and the unit of frequency are not printed; the corners stand in the paper's own unit of
/// frequency. The paper has one symbol ζ for numerator and denominator, with which the squared quadratics cancel.
struct PaperBodeModel {
  double zero = 0;              ///< 1.05 · 12.5
  double pole = 0;              ///< 1.75 · 3.5 or 1.05 · 3.5
  double quadratic_corner = 0;  ///< 8.5 or 7.5
  int lags_at_ten = 0;          ///< 2 or 3
};
inline constexpr PaperBodeModel kPaperEquation16{1.05 * 12.5, 1.75 * 3.5, 8.5, 2};
inline constexpr PaperBodeModel kPaperEquation17{1.05 * 12.5, 1.05 * 3.5, 7.5, 3};

/// damping ratios  0 < ζ ≤ 1
TransferFunction transfer_function_of(const PaperBodeModel& model, double zero_damping_ratio,
                                      double pole_damping_ratio);
/// The same with one ζ: the quadratics cancelled.
TransferFunction cancelled(const PaperBodeModel& model);

/// A coefficient as printed and half a unit of its last printed digit: every value that rounds to it.
struct PrintedCoefficient {
  double value = 0;
  double half_unit = 0;
};

/// Eqs 18 (good valve) and 19 (returned valve): powers of z⁻¹. No sample time is printed: 1 stands for it, so that
/// nothing that follows may be quoted in hertz. Both are unstable.
struct PaperDiscreteModel {
  std::vector<double> numerator;
  std::vector<PrintedCoefficient> denominator;
};
PaperDiscreteModel paper_equation_18();
PaperDiscreteModel paper_equation_19();

RationalCoefficients coefficients_of(const PaperDiscreteModel& model);
TransferFunction transfer_function_of(const PaperDiscreteModel& model);

}  // namespace valvetriage
