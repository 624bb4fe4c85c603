#pragma once

#include "core/classify/rivals/rival.h"

namespace valvetriage {

/// A self-organising map, trained in batches, its nodes labelled by the valves they win.
///
///   w_i = Σ_j h(i, c_j) x_j / Σ_j h(i, c_j)        h(i, c) = exp(−|r_i − r_c|² / 2σ²),  σ shrinks from side/2 to 1/2
///
/// The map starts on the plane of the first two principal components, so nothing is random. A node's degrees are the
/// neighbourhood-weighted shares of the classes around it.
///
/// Source  T. Kohonen, Self-Organizing Maps, 3rd ed., Springer 2001, section 3.6 (batch map); as a pattern classifier
/// of
///         processes: B. Bhushan and J. Romagnoli, Ind. Eng. Chem. Res. 47 (2008) 4209 (paper reference 6)
/// Cost    O(iterations · n · side² · p) to train; deterministic
struct SelfOrganisingMapOptions {
  int side = 4;
  int iterations = 30;
};
RivalClassifier train_self_organising_map(const TrainingSet& training, const SelfOrganisingMapOptions& options = {});

}  // namespace valvetriage
