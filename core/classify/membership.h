#pragma once

#include <limits>

namespace valvetriage {

/// A trapezoidal fuzzy set, and with it every set of the paper (Eqs 21 and 22):
///
///   μ(x) = 0 outside [a, d],  (x − a)/(b − a) on [a, b],  1 on [b, c],  (d − x)/(d − c) on [c, d]
///
/// left trapezoid    a = b = −∞ (open to the left)
/// triangle          b = c
/// right trapezoid   c = d = +∞ (open to the right)
/// a, b, c, d   a ≤ b ≤ c ≤ d, unit of the quantity; a vertical edge (a = b or c = d) belongs to the set
struct Trapezoid {
  double a = 0, b = 0, c = 0, d = 0;

  bool operator==(const Trapezoid&) const = default;
};

inline constexpr double kOpen = std::numeric_limits<double>::infinity();

/// Left trapezoid of Eqs 21 and 22: 1 up to x1, falling to 0 at x3.
constexpr Trapezoid left_trapezoid(double one_until, double zero_from) {
  return {-kOpen, -kOpen, one_until, zero_from};
}

/// Triangle of Eq 22.
constexpr Trapezoid triangle(double from, double peak, double to) {
  return {from, peak, peak, to};
}

/// Right trapezoid of Eqs 21 and 22: 0 up to x2, rising to 1 at x4.
constexpr Trapezoid right_trapezoid(double zero_until, double one_from) {
  return {zero_until, one_from, kOpen, kOpen};
}

/// Degree of membership of x, 0 to 1; 0 where x is NaN.
constexpr double membership(const Trapezoid& set, double x) {
  if (x >= set.b && x <= set.c) return 1.0;
  if (x > set.a && x < set.b) return (x - set.a) / (set.b - set.a);
  if (x > set.c && x < set.d) return (set.d - x) / (set.d - set.c);
  return 0.0;
}

/// a ≤ b ≤ c ≤ d, no NaN, and an infinite corner only as an open shoulder (both corners of that side).
constexpr bool is_trapezoid(const Trapezoid& set) {
  const bool ordered = set.a <= set.b && set.b <= set.c && set.c <= set.d;
  const bool left_open = set.a == -kOpen && set.b == -kOpen;
  const bool right_open = set.c == kOpen && set.d == kOpen;
  const bool left_ok = left_open || (set.a > -kOpen && set.b < kOpen);
  const bool right_ok = right_open || (set.c > -kOpen && set.d < kOpen);
  return ordered && left_ok && right_ok;
}

}  // namespace valvetriage
