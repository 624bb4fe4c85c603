#pragma once

#include <complex>
#include <cstddef>
#include <span>
#include <vector>

namespace valvetriage {

/// A stable denominator of order 1 or 2 in the difference operator w = 1 − z⁻¹, so that poles near 1 keep their digits:
///
///   order 2   D = (1 − e) w² + (e − f) w + f      f = (1 − p₁)(1 − p₂)    e = 1 − p₁ p₂     0 < e < 2, 0 < f < 4 − 2e
///   order 1   D = (1 − f) w + f                   f = 1 − p                                 0 < f < 2
///
/// Every pair of poles inside the unit circle is one (e, f) and the reverse. H = f / D has static gain 1.
struct Section {
  int order = 2;
  double e = 0;  ///< order 2 only
  double f = 0;
};

/// Range that an identified section must stay in, for a record of so many samples.
///
/// A complex pair must not ring for longer than a third of the record: e ≥ 6 / samples, for its envelope falls as
/// exp(−e t / 2). Below slow_rate a mode is slower than half the record: allowed, at a price.
struct SectionLimits {
  explicit SectionLimits(std::size_t samples);
  double least_e;
  double least_f;
  double slow_rate;
};

/// The section moved into the limits and the stable region, by as little as each coordinate needs.
Section clamped(Section section, const SectionLimits& limits);

/// Rate of the section's slowest real pole [per sample], roughly: f / e, or f for order 1.
double slowest_rate(const Section& section);

/// Order / 2 sections of order 2 and one of order 1 where the order is odd, it last. Complex pairs stay together.
/// Poles outside the unit circle are mirrored into it.
std::vector<Section> sections_from_poles(std::span<const std::complex<double>> poles, const SectionLimits& limits);
std::vector<std::complex<double>> poles_of(std::span<const Section> sections);
/// All poles at 1 − rate.
std::vector<Section> equal_sections(int order, double rate, const SectionLimits& limits);
int order_of(std::span<const Section> sections);
/// Gain at rest of weights on a cascade's basis: levels and the input have gain 1, differences none.
double gain_at_rest(std::span<const Section> sections, std::span<const double> weights);

/// One section at work: level y and difference v = y(t) − y(t−1). A response that has died out is set to zero now and
/// then by settle(), for numbers below 1e-308 would cost a hundred times more.
struct SectionState {
  static constexpr double kSettled = 1e-200;

  double keep = 0;  ///< 1 − e, 0 for order 1
  double f = 0;
  double level = 0;
  double difference = 0;

  SectionState() = default;
  SectionState(const Section& section, double rest)
      : keep(section.order == 2 ? 1 - section.e : 0), f(section.f), level(rest) {}
  /// y(t) of H x, from x(t).
  double step(double x) {
    difference = keep * difference + f * (x - level);
    return level += difference;
  }
  void settle();
};

/// DifferencePolynomial in w, ascending powers.
using DifferencePolynomial = std::vector<double>;
DifferencePolynomial multiply(const DifferencePolynomial& a, const DifferencePolynomial& b);
DifferencePolynomial denominator(const Section& section);

/// Numerators over ∏D of the basis that a cascade of sections s₁ … s_m offers: y_m, v_m, y_(m−1), … , then 1 · ∏D.
/// Entry i has degree i (or less), order + 1 entries. v stands only for sections of order 2.
std::vector<DifferencePolynomial> basis_numerators(std::span<const Section> sections);

/// The same polynomial in ascending powers of z⁻¹.
std::vector<double> in_powers_of_delay(const DifferencePolynomial& in_w);
/// And back.
DifferencePolynomial in_powers_of_difference(std::span<const double> in_delay);

/// Roots z of a polynomial in w, z = 1 / (1 − w); roots at infinity are left out.
std::vector<std::complex<double>> z_roots(const DifferencePolynomial& in_w);

}  // namespace valvetriage
