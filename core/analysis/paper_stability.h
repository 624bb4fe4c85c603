#pragma once

#include <complex>

#include "core/model/paper_models.h"

namespace valvetriage {

/// Proof that a printed denominator has a root outside the unit circle for every value that rounds to its digits.
///
/// Rouché's theorem on |z| = R ≥ 1: where |P(z)| > Σ δ_k R^{n−k} ≥ |change of P(z)| all the way round, every polynomial
/// of the box has as many roots outside as P. min |P| is bounded from below by Taylor's bound around samples of the
/// circle. Where P'(1) < 0 throughout, Gauss and Lucas settle it at once. The one coefficient with the widest interval
/// is halved until each piece is proved on a circle of its own.
///
/// proven          every piece has its circle with a root of its polynomial outside, or the sign of P'(1)
/// pieces          into how many the widest interval was cut
/// smallest_margin smallest min|P| / Σ δ_k R^{n−k} over the pieces proved by Rouché; above 1
struct InstabilityProof {
  bool proven = false;
  int pieces = 0;
  double smallest_margin = 0;
};
InstabilityProof prove_unstable(const PaperDiscreteModel& model);

/// The smallest product of the roots' moduli over all values that round to the digits: above 1, some root lies outside.
double smallest_root_product(const PaperDiscreteModel& model);

/// What is wrong with Eq 18 and Eq 19.
struct PaperPoleCheck {
  std::complex<double> largest_pole;
  double largest_modulus = 0;
  double static_gain = 0;
  double numerator_sum = 0;
  double denominator_sum = 0;
  double pole_product = 0;  ///< of the moduli
};
PaperPoleCheck check_poles(const PaperDiscreteModel& model);

}  // namespace valvetriage
