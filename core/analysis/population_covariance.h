#pragma once

#include <Eigen/Core>
#include <vector>

namespace valvetriage {

/// Valve-to-valve covariance of [parameters | knot outputs] from a handful of good valves.
///
///   C = D [ (1 − λ) S + λ T ] D
///
/// S is the sample covariance. T knows what differs between valves: parameters independently, each with its own
/// variance; maps as a Gaussian process with a common shift along the input, local shifts over a tenth of an ampere
/// (times `scale`), a gain, an offset and a part of each knot's own, their sizes by maximum likelihood; where that
/// tells it, given that a screw has set all of them alike at one point. λ is what predicts each valve best from the
/// others (leave-one-out likelihood); D is 1 for the parameters, whose variances are those of the sample, and makes the
/// mean squared distance of a left-out valve's map at least what it claims to be. A covariance ten times too tight
/// would accuse good valves, one ten times too loose would miss faults.
///
/// vectors     one column per valve, p rows, at least 2: estimates
/// errors      p × p, covariance of their errors, the mean over the valves; what T does not have to explain. S has them
///             in it
/// parameters  how many of the rows stand before the knots
/// knots       inputs of the knots, p − parameters, evenly spaced [A]
/// scale       of these valves' currents, as UsualMechanisms::current_scale
/// Source      shrinkage: Ledoit, Wolf, J. Multivariate Analysis 88 (2004) 365
struct PopulationCovariance {
  Eigen::MatrixXd covariance;
  double log_likelihood = 0;  ///< of each valve from the others, up to a constant
};
PopulationCovariance population_covariance(const Eigen::MatrixXd& vectors, const Eigen::MatrixXd& errors,
                                           Eigen::Index parameters, const std::vector<double>& knots, double scale = 1);

}  // namespace valvetriage
