#pragma once

#include <complex>
#include <span>
#include <vector>

namespace valvetriage {

/// Real coefficients, leading one first: p(x) = c[0] xⁿ + … + c[n]. Extended precision, because the roots of a
/// polynomial with clustered roots move by the n-th root of what its coefficients are rounded by.
using Polynomial = std::vector<long double>;

/// ∏ (x − roots[i]), monic. Complex roots come in conjugate pairs. Cost O(n²).
Polynomial expand(std::span<const std::complex<double>> roots);

/// p(x + shift) as a polynomial in x. Cost O(n²).
Polynomial shifted(Polynomial p, long double shift);

/// All roots: eigenvalues of the balanced companion matrix, polished by Aberth's iteration in extended precision.
/// Conjugate pairs are exact. p[0] ≠ 0 and all coefficients finite. Cost O(n³).
std::vector<std::complex<double>> roots(const Polynomial& p);

}  // namespace valvetriage
