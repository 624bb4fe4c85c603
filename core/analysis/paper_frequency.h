#pragma once

#include "core/model/paper_models.h"

namespace valvetriage {

/// Paper Eq 3 in corner form, t = 1 for a pole and −1 for a zero:
///
///   Lm g(x) = t (x_i − ½ ln(e^{2x} + e^{2 x_i})),  x = ln ω,  x_i = ln|corner|     [neper]
double corner_log_gain(double x, double corner, double t);
/// The same as printed, bracket misplaced: t (x_i − ½ ln e^{2x} + e^{2 x_i}).
double corner_log_gain_as_printed(double x, double corner, double t);
/// Paper Eq 4.
double asymptote(double x, double corner, double t);
/// Paper Eq 5, right-hand side: asymptote minus curve.
double asymptote_gap(double x, double corner, double t);

/// Eqs 2 to 5 on a grid of ten e-folds either side of a corner, for poles and zeros. [neper]
struct CornerFormCheck {
  double largest_deviation = 0;             ///< of Eq 4 − corner form from Eq 5
  double largest_deviation_as_printed = 0;  ///< of Eq 4 − Eq 3 as printed from Eq 5
  double largest_gap = 0;                   ///< of the asymptote, at the corner: ½ ln 2
  double response_deviation = 0;            ///< of the corner form from ln|G(jω)| of an s/(−p) + 1 transfer function
};
CornerFormCheck check_corner_form();

/// Angular frequency at which |G| has fallen to 1/√2 of its static value, in the unit of the corners: the first
/// crossing.
double half_power_frequency(const TransferFunction& g);

}  // namespace valvetriage
