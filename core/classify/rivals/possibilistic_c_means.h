#pragma once

#include "core/classify/rivals/rival.h"

namespace valvetriage {

/// Possibilistic c-means: typicality of a valve to each cluster, free of the constraint that degrees add up to 1.
///
///   t_ij = 1 / (1 + (d²_ij / η_i)^(1/(m−1)))        v_i = Σ_j t_ij^m x_j / Σ_j t_ij^m        η_i = Σ u^m d² / Σ u^m
///
/// Prototypes start at the class means and are refined by fuzzy c-means (which gives u and η), then by the
/// possibilistic updates, which see no labels; a cluster keeps the class it started from. One cluster per labelled
/// class.
///
/// Source  R. Krishnapuram and J. Keller, A possibilistic approach to clustering, IEEE Trans. Fuzzy Systems 1 (1993)
/// 98;
///         for fault detection K. Detroja and others, J. Process Control 16 (2006) 1055 (paper reference 8)
/// Cost    O(iterations · n · c · p) to train; deterministic
struct PossibilisticOptions {
  double fuzzifier = 2.0;
  int most_iterations = 100;
};
RivalClassifier train_possibilistic_c_means(const TrainingSet& training, const PossibilisticOptions& options = {});

}  // namespace valvetriage
