#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "core/classify/verdict.h"

namespace valvetriage {

/// Labelled feature vectors: one row per valve, every row with every feature.
struct TrainingSet {
  Eigen::MatrixXd features;       ///< n × p
  std::vector<Verdict> verdicts;  ///< n
};

struct RivalPrediction {
  Verdict verdict = Verdict::kGood;
  Memberships memberships{};  ///< degrees or shares of votes, 0 to 1
};

/// A trained rival: a feature vector of p values to a verdict. Pure and thread-safe.
using RivalClassifier = std::function<RivalPrediction(const Eigen::VectorXd&)>;

/// Brings every feature to mean 0 and standard deviation 1 of the training set: all rivals measure distances.
/// A feature that does not vary is left at 0.
class Standardiser {
 public:
  explicit Standardiser(const Eigen::MatrixXd& features);
  Eigen::VectorXd operator()(const Eigen::VectorXd& x) const;
  Eigen::MatrixXd all(const Eigen::MatrixXd& features) const;

 private:
  Eigen::RowVectorXd mean_;
  Eigen::RowVectorXd inverse_sd_;
};

/// The verdict of the largest degree with the degrees themselves.
RivalPrediction by_largest(const Memberships& memberships);

}  // namespace valvetriage
