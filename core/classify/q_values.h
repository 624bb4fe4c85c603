#pragma once

#include <span>
#include <vector>

namespace valvetriage {

/// How many of the names given to a lot may be false.
///
/// A name of probability p is false with 1 − p. Of all names at least as probable as the i-th one the expected share of
/// false ones is its q-value:
///
///   q_i = mean over { j : p_j ≥ p_i } of (1 − p_j)
///
/// Taking every name with q ≤ α as true is wrong in a share α of them on the average, if the probabilities are right.
/// Source   Müller, Parmigiani, Robert, Rousseau, J. Am. Stat. Assoc. 99 (2004) 990; Newton, Noueiry, Sarkar, Ahlquist,
///          Biostatistics 5 (2004) 155
///
/// probabilities  of the names, 0 to 1, in any order
/// Returns        one q-value per name, in the same order
/// Cost           O(n log n)
std::vector<double> q_values(std::span<const double> probabilities);

/// Σ (1 − p): how many of the names are expected to be false.
double expected_false(std::span<const double> probabilities);

}  // namespace valvetriage
