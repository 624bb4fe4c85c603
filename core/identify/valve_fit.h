#pragma once

#include <Eigen/Core>
#include <array>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "core/mechanisms/mechanism.h"
#include "core/model/mode.h"
#include "core/model/model.h"
#include "core/model/valve_dynamics.h"
#include "core/recording/recording.h"

namespace valvetriage {

/// The physical parameters of a valve, beside its static map. Each but the delay and the exponent is positive and is
/// estimated in its logarithm.
struct ValveParameters {
  ValveDynamics spool;             ///< delay, natural frequency and damping of coil and spool
  double loop_width_a = 0;         ///< magnetic loop, ≥ 0 [A]
  OrificeVolume volume;            ///< time constant, flow exponent, supply pressure
  double narrow_loop_width_a = 0;  ///< what dry friction of a good spool adds to it at small reversals, ≥ 0 [A]
  /// Behind the map, where the spool is prompt (UsualMechanisms::prompt_spool_rad_s): the natural frequency and the
  /// damping are its own then.
  std::optional<Mode> mode;

  /// By how much a pressure follows what the map asks for, of slow changes [s].
  double lag_behind_map_s() const {
    return volume.time_constant_s + (mode ? 2 * mode->damping_ratio / mode->natural_frequency_rad_s : 0);
  }
};

/// One entry of the parameter vector.
struct ValveParameterInfo {
  std::string_view name;
  std::string_view unit;
  bool logarithmic = false;
};

/// Entries of the parameter vector, in order; the map's knot outputs follow behind them.
inline constexpr std::array<ValveParameterInfo, 8> kValveParameters{{{"natural_frequency_rad_s", "rad/s", true},
                                                                     {"damping_ratio", "", true},
                                                                     {"delay_s", "s", false},
                                                                     {"loop_width_A", "A", false},
                                                                     {"volume_time_constant_s", "s", true},
                                                                     {"flow_exponent", "", false},
                                                                     {"supply_psi", "psi", true},
                                                                     {"narrow_loop_width_A", "A", false}}};

/// What is known of a valve before it is measured: mean and covariance over [parameters | knot outputs].
struct ValvePrior {
  Eigen::VectorXd mean;        ///< p
  Eigen::MatrixXd covariance;  ///< p × p, positive definite
};

/// The prior for a new valve from n good ones: their covariance, and the uncertainty of a mean over n on top.
ValvePrior population_prior(Eigen::VectorXd mean, Eigen::MatrixXd covariance, double valves);

/// What good valves of one type share and a single valve does not tell apart from its spool: known beforehand, not
/// fitted. Nothing by default.
struct UsualMechanisms {
  double gauge_lag_s = 0;  ///< first-order lag of the gauge, ≥ 0 [s]
  /// 0: the second-order dynamics are the spool's, ahead of the map. Else the spool is critically damped, this fast and
  /// the same in all, and the dynamics are a mode of what fills behind the map: the order of Hammerstein's models.
  double prompt_spool_rad_s = 0;
  double air_share = 0;  ///< of the volume's capacity at the reference pressure, ≥ 0
  /// Shape of the magnetic loop: how its width is shared, without the narrowest, which is a parameter of each valve.
  MagneticLoop::Shares loop_shares{0, 1.0 / 3, 1.0 / 3, 1.0 / 3};
  /// What the currents of these valves are to those of valves that move over 1 A or more, 0 < scale ≤ 1: the reach of
  /// the loop and every constant of a fit that is told in A go with it.
  double current_scale = 1;
  /// What plays their commands; told by the stand, not by the valve.
  InputBetween input_between = InputBetween::kStraight;
};

/// To the vector's first entries, logarithms taken, and back. `reference_psi` is where the time constant holds.
Eigen::VectorXd to_vector(const ValveParameters& parameters);
ValveParameters to_parameters(const Eigen::VectorXd& vector, double reference_psi, const UsualMechanisms& usual);

/// Both loops of a valve as one.
MagneticLoop loop_of(const ValveParameters& parameters, const UsualMechanisms& usual, double memory = 0);

/// A physical cause that takes part in a fit: its law, bounds and starting point, and where it acts.
struct LawInFit {
  const Mechanism* law = nullptr;
  std::vector<double> start, lower, upper, step;  ///< one per parameter of the law
  std::optional<std::size_t> recording;           ///< acts in this recording alone
  std::optional<std::size_t> channel;             ///< the side channel it looks at

  /// Parameters that all recordings share, and those that each has its own of.
  std::size_t own() const { return law->own_per_recording; }
  std::size_t shared() const { return law->parameters.size() - own(); }
  /// What decides it is a whole number, which a fit does not vary.
  bool acts_in_blocks_alone() const { return law->acts_in_blocks_alone(lower); }
};

struct ValveFitOptions {
  std::vector<double> knots;        ///< inputs of the map's knots, strictly increasing, as `map_knots` has them [A]
  double reference_psi = 0;         ///< where the volume's time constant holds; one number per valve type [psi]
  std::optional<ValvePrior> prior;  ///< the population; empty: physics' own wide preferences and a smooth map
  std::optional<ValveParameters> start;  ///< instead of the fan of starting points
  std::vector<LawInFit> laws;            ///< fitted together with the valve
  UsualMechanisms usual;                 ///< part of every simulation
  int most_iterations = 40;
};

enum class FitTermination : std::uint8_t { kConverged, kIterationLimit, kNoDescent, kGivenUp };

/// One valve's model, from all its recordings together: shared physics, own initial states.
struct ValveFit {
  ValveParameters parameters;
  StaticMap map;                               ///< monotone
  Eigen::MatrixXd covariance;                  ///< p × p over [parameters | knot outputs], from the measured noise
  std::vector<std::vector<double>> simulated;  ///< free run on each recording's grid, from its estimated initial state
  double rmse = 0;                             ///< over all valid samples [psi]
  std::array<bool, kValveParameters.size()> at_bound{};  ///< which parameters end where their bounds hold them
  /// Everything fitted, in the order of ValveFitProblem, the map as the samples have it: not made to rise, as none is
  /// that is fitted together with a law.
  Eigen::VectorXd vector;
  FitTermination termination = FitTermination::kConverged;
  int iterations = 0;
};

/// Free-run (output-error) least squares of all parameters and the map together.
///
///   u → magnetic loop → delay, spool → map → mode → volume → gauge → y + noise         (Model, kind "valve")
///
/// Estimated with them, per recording: two states of the spool or the mode, the volume's pressure and the loop's memory
/// at its start. The residual of each recording is weighted by its noise floor. Small changes are carried through the
/// volume by its tangent, so a knot costs one multiplication per sample. Gauss-Newton with Levenberg's damping, several
/// starts. The map is made monotone at the end (pool adjacent violators). Samples that are not valid take no part.
///
/// Without a prior the exponent prefers 0.6 ± 0.25 (turbulent 1/2 to laminar 1) and the supply 2.5 times the largest
/// pressure within a factor of two: where the data speak, thousands of samples outvote both.
///
/// Errors  no recordings; not in valve units; fewer than two knots
/// Cost    O(n · knots²) per iteration, blocks of rows, no allocation per sample; deterministic
Result<ValveFit> fit_valve(std::span<const Recording> recordings, const ValveFitOptions& options);

/// From the least to the largest input of some recordings [A].
struct InputSpan {
  double low_a = std::numeric_limits<double>::infinity();
  double high_a = -std::numeric_limits<double>::infinity();

  void widen(std::span<const Recording> recordings);
  /// min(1, width / 1 A), the `current_scale` of valves that are played over it.
  double current_scale() const;
};

/// Knots that cover the inputs of the recordings, 0.025 A apart, a fortieth of the span where that is less than 1 A.
/// Errors: an input that never changes.
Result<std::vector<double>> map_knots(std::span<const Recording> recordings);
Result<std::vector<double>> map_knots(const InputSpan& span);

/// Half of the largest output of the recordings, where a volume's time constant is quoted [psi].
double reference_pressure(std::span<const Recording> recordings);

/// Parameters and map as a Model: kind "valve", dynamics in the s domain; the gauge's lag, where it has one, is the
/// first of its mechanisms, an `extra_lag`.
Model to_model(const ValveParameters& parameters, const StaticMap& map, const UsualMechanisms& usual = {});

/// What such a model of a good valve has of them.
UsualMechanisms usual_mechanisms(const Model& model);

}  // namespace valvetriage
