#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "core/model/reference.h"
#include "core/model/valve_dynamics.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// What is known of a valve before it is measured: the population's mean and covariance over the parameter vector
/// (ln natural frequency, ln damping ratio, ln lags, delay; then the map's knot outputs).
struct ValvePrior {
  ValveDynamics dynamics;
  StaticMap map;
  Eigen::MatrixXd covariance;  ///< p × p
};

struct ValveFitOptions {
  std::vector<double> knots;           ///< inputs of the map's knots, strictly increasing, 0.025 A apart or finer
  int order = 2;                       ///< of the dynamics, 2 to 5
  std::optional<ValvePrior> prior;     ///< empty: a slight preference for a smooth map alone
  std::optional<ValveDynamics> start;  ///< instead of the fan of natural frequencies
  int most_iterations = 40;
};

enum class FitTermination { kConverged, kIterationLimit, kNoDescent };

/// One valve's model, from all its recordings together: shared physics, own initial states.
struct ValveFit {
  ValveDynamics dynamics;
  StaticMap map;                               ///< monotone
  Eigen::MatrixXd covariance;                  ///< p × p, of the vector described at ValvePrior, noise as measured
  std::vector<std::vector<double>> simulated;  ///< free run on each recording's grid, from its estimated initial state
  double rmse = 0;                             ///< over all valid samples [psi]
  FitTermination termination = FitTermination::kConverged;
  int iterations = 0;
};

/// Free-run (output-error) least squares of delay, dynamics and map together.
///
///   y = G(s; ωn, ζ, τ) e^(−s delay) map(u) + free response of the initial state + noise
///
/// Linear in the knots and the initial states, so those columns are exact; the dynamics' sensitivities are differences
/// of simulations; Gauss-Newton with Levenberg's damping, started from several natural frequencies. Samples that are
/// not valid take no part. The map is made monotone at the end (pool adjacent violators, weights from the fit).
///
/// Errors  no recordings; recordings whose sampling periods allow no simulation; not in valve units
/// Cost    O(n · (knots + order · recordings)²) per iteration; no allocation per sample
Result<ValveFit> fit_valve(std::span<const Recording> recordings, const ValveFitOptions& options);

/// Knots 0.025 A apart that cover the inputs of the recordings. Errors: an input range of nothing.
Result<std::vector<double>> map_knots(std::span<const Recording> recordings);

/// The dynamics as the first entries of the parameter vector (ln ωn, ln ζ, ln τ…, delay), and back.
Eigen::VectorXd to_vector(const ValveDynamics& dynamics);
ValveDynamics to_dynamics(const Eigen::VectorXd& vector);

/// The same dynamics with its real poles in one order: the fastest ones stand as lags, so that two valves' parameters
/// can be compared entry by entry.
ValveDynamics canonical(const ValveDynamics& dynamics);

/// The fit as a Model: kind "valve", dynamics in the s domain.
Model to_model(const ValveFit& fit);

}  // namespace valvetriage
