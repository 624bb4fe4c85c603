#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/model/model.h"

namespace valvetriage {

/// One dynamic parameter of the valve model over the population of good valves.
///
/// value scale   `transform` "log": the population is described in ln(value); "linear": in the value itself
struct PopulationParameter {
  std::string name;       ///< of kValveParameters (core/identify/valve_fit.h)
  std::string unit;       ///< "s", "rad/s", ""
  std::string transform;  ///< "linear" or "log"
  double mean = 0;        ///< in the transformed scale
  double sd = 0;          ///< valve to valve, in the transformed scale
};

/// What a good valve leaves on one level: the yardstick of a verdict and of a rule base.
struct LevelPopulation {
  double level_a = 0;              ///< [A]
  double error_eq20_mean = 0;      ///< [psi/s]
  double error_eq20_sd = 0;        ///< [psi/s]
  double settling_error_mean = 0;  ///< [psi]
  double settling_error_sd = 0;    ///< [psi]
  double rise_time_mean_s = 0;     ///< 10 to 90 %, 0 where no good valve showed a rise
  double rise_time_sd_s = 0;       ///< [s]
};

/// The window on which Eq 20 is taken: its value depends on both, so they belong to every figure made with it.
struct Eq20Window {
  double rate_hz = 0;     ///< samples per second the residual is brought to
  double duration_s = 0;  ///< from the step on
};

/// A good valve that took part in the learning, and how far it stands from the others.
struct ReferenceMember {
  std::string serial;
  int recordings = 0;
  double rmse = 0;      ///< of its own fitted model, free run [psi]
  double distance = 0;  ///< robust distance from the population, in standard deviations
  bool used = true;     ///< false: pointed out as unlike the others and left out
};

/// How much of a cause good valves seem to have, each against the population of the others: what noise, spread and the
/// simulation's own bias make of it where nothing is wrong.
struct CauseOnGoodValves {
  std::string cause;
  double evidence_mean = 0;  ///< reduction of the whitened cost, noise colour taken off
  double evidence_sd = 0;    ///< between valves; 0 if not known
  double size_mean = 0;      ///< of the law's size parameter
  double size_sd = 0;
  std::optional<int> size_valves{};  ///< of which the size is known, all where absent: a limit that few of them reach
                                     ///< has none in the others
};

/// How unevenly good valves' residuals are spread: ln of a group of samples' mean square over the noise's; or how far
/// they go along what no cause stands for: ln(1 + evidence in noise variances), under the direction's name; or ln of
/// what a fit costs over what its noise does, under "above the noise".
struct LeftoverOnGoodValves {
  std::string group;
  double mean = 0, sd = 0;
  std::optional<int> valves{};  ///< with enough samples in the group, all where absent
};

/// A test that good valves were put through, and what their simulations leave in common there.
struct KnownTest {
  double sample_period_s = 0;
  std::vector<double> input;     ///< as it was played to one of them, one value a sample [A]
  std::vector<double> residual;  ///< measured less simulated, as far as it is common to them [psi]
};

struct OnKnownTests;

/// A population of good valves, learned from their recordings; not a curve.
///
/// Parameter vector of one valve, p entries: `parameters` in their order, then the map's knot outputs. `covariance` is
/// p × p over that vector in the transformed scale, row major, shrunk towards its diagonal (few valves).
struct Reference {
  std::string valve_type;
  int version = 0;  ///< given by the store; 0 for a file
  std::string sha256;
  std::vector<ReferenceMember> members;
  int valves = 0;  ///< members used

  double sample_period_s = 0;  ///< of the learning recordings, median [s]
  Model model;                 ///< the population mean: kind "valve", dynamics in the s domain
  std::vector<double> map_sd;  ///< valve to valve, one per knot of model.map [psi]
  std::vector<PopulationParameter> parameters;
  std::vector<double> covariance;
  double prior_degrees_of_freedom = 0;  ///< of the Student t that stands for the population

  double noise_floor = 0;          ///< rms of the irreducible noise on good valves [psi]
  double input_min = 0;            ///< [A]
  double input_max = 0;            ///< [A]
  double bandwidth_hz = 0;         ///< highest frequency that the learning recordings excited
  std::vector<std::string> tests;  ///< kinds of test seen
  Eq20Window window;               ///< default window, where no rule base brings its own
  std::vector<LevelPopulation> levels;
  std::vector<CauseOnGoodValves> causes;
  std::vector<LeftoverOnGoodValves> leftovers;

  /// Where simulations leave much in common of good valves: what a valve that was put through the same tests is
  /// compared with. At most one.
  std::vector<OnKnownTests> on_known_tests;
};

/// What good valves are like once what their simulations leave in common is taken off.
struct OnKnownTests {
  std::vector<KnownTest> tests;
  Reference reference;  ///< learned of the same valves once that is taken off, itself without any
};

}  // namespace valvetriage
