#pragma once

#include "core/classify/rivals/rival.h"

namespace valvetriage {

/// k nearest neighbours on principal components (PC-kNN).
///
/// Standardised features are projected on the leading principal components that carry `variance_share` of the variance;
/// the k nearest training valves there vote.
///
/// Source  Q. P. He and J. Wang, Principal component based k-nearest-neighbor rule for semiconductor process fault
///         detection, American Control Conference 2008 (paper reference 3). Theirs tells good from not good by a
///         distance limit; with labelled faults at hand the neighbours vote here, as in T. Cover and P. Hart, IEEE IT
///         13 (1967) 21
/// Cost    O(n p) per prediction
struct PcKnnOptions {
  int neighbours = 3;
  double variance_share = 0.95;
};
RivalClassifier train_pc_knn(const TrainingSet& training, const PcKnnOptions& options = {});

}  // namespace valvetriage
