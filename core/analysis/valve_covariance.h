#pragma once

#include <Eigen/Core>
#include <vector>

namespace valvetriage {

inline constexpr Eigen::Index kFewestWithSlopes = 8;

/// Valve-to-valve covariance of [kValveParameters | knot outputs] from a handful of good valves: population_covariance
/// in the coordinates that predict each valve best from the others, and back.
///
/// Parameters need not vary independently. Recordings may tell the whole delay of a valve, delay + 2 ζ / ωn, far better
/// than how it is shared between its parts; and a lag that the model has none for, a driver's or a gauge's, is part
/// delay and part damping to it. Tried are the parameters themselves, the whole delay in the place of the delay, and
/// from eight valves on the delay less what goes with frequency and damping of the spool, both slopes by ridge
/// regression (Hoerl and Kennard, Technometrics 12 (1970) 55) as if eight further valves had shown none, and paid for
/// (Akaike).
///
/// left_out how many of the valves stand aside, to be judged by the others: these are treated as they would be with
///          all of them
/// vectors  one column per valve, at least 2: estimates, parameters in their transformed scale
/// errors   covariance of their errors, the mean over the valves
/// knots    inputs of the knots, evenly spaced [A]
/// scale    of these valves' currents, as UsualMechanisms::current_scale
Eigen::MatrixXd valve_covariance(const Eigen::MatrixXd& vectors, const Eigen::MatrixXd& errors,
                                 const std::vector<double>& knots, double scale = 1, Eigen::Index left_out = 0);

}  // namespace valvetriage
