#pragma once

#include "core/classify/rivals/rival.h"

namespace valvetriage {

/// A first-order Sugeno system trained as ANFIS is.
///
///   y(x) = Σ_r w̄_r (p_r + q_rᵀ x)        w̄_r = w_r / Σ w        w_r = Π_i exp(−(x_i − c_ri)² / 2 s_ri²)
///
/// Hybrid learning: with the premises fixed, the consequents p, q come from (lightly ridged) least squares; with the
/// consequents fixed, centres c and widths s take one gradient step; repeated. One rule per labelled class, premises
/// starting at the class's mean and spread (scatter partition: a grid over many features has no room for its rules in
/// tens of valves). The target is 0 Good, 1 Malfunctioned, 2 Severe; the degrees are triangles around those.
///
/// Source  J.-S. R. Jang, ANFIS, IEEE Trans. SMC 23 (1993) 665; as a diagnostic classifier: X. Lou and K. Loparo, Mech.
///         Systems and Signal Processing 18 (2004) 1077 (paper reference 4)
/// Cost    O(epochs · n (r p)²); deterministic
struct AnfisOptions {
  int epochs = 50;
  double step = 0.05;   ///< of a standard deviation, per epoch: the length of the gradient step
  double ridge = 1e-3;  ///< on the consequents, relative to n
};
RivalClassifier train_anfis(const TrainingSet& training, const AnfisOptions& options = {});

}  // namespace valvetriage
