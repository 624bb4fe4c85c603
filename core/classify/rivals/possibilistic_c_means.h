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
///
/// most_starts  of possibilistic_groups: rows it runs from
struct PossibilisticOptions {
  double fuzzifier = 2.0;
  int most_iterations = 100;
  int most_starts = 200;
};
RivalClassifier train_possibilistic_c_means(const TrainingSet& training, const PossibilisticOptions& options = {});

/// A cluster that was found without labels.
struct PatternGroup {
  Eigen::RowVectorXd prototype;      ///< p values
  std::vector<std::size_t> members;  ///< rows, most typical first, two at least
  std::vector<double> typicality;    ///< of each member, 1/2 at least
};

/// Groups of rows that lie together, as many as there are: the same updates with one given η, run from the rows that
/// lie densest and belong to no cluster yet, most_starts at most; where several end at the same place there is one
/// cluster. Rows of typicality below 1/4 do not pull: however many they are, a small group stays where it is. A row
/// belongs to the cluster it is most typical of, if its typicality there is 1/2 at least; rows that lie alone belong to
/// none.
///
///   Possibilistic clusters do not repel each other: each seeks a dense place by itself, so that the number of clusters
///   need not be known (R. Krishnapuram and J. Keller, IEEE Trans. Fuzzy Systems 4 (1996) 385). The densest places
///   first as in subtractive clustering (S. Chiu, J. Intelligent and Fuzzy Systems 2 (1994) 267); how dense, 512 rows
///   tell.
///
/// x        n × p, on the scale that distances are meant on
/// eta      squared distance of typicality 1/2, > 0
/// options  a fuzzifier near 1 lets far rows weigh less
/// Returns  largest group first; groups of one are none
/// Cost     O(starts · iterations · n · p), O(n · p) of memory; deterministic
std::vector<PatternGroup> possibilistic_groups(const Eigen::MatrixXd& x, double eta,
                                               const PossibilisticOptions& options = {});

}  // namespace valvetriage
