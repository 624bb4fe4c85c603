#pragma once

#include <optional>
#include <string>
#include <vector>

#include "core/discrepancy/machine_fit.h"
#include "core/identify/output_error.h"

namespace valvetriage {

/// The linear machine of one order, fitted in free run.
struct LinearMachine {
  int order = 0;
  MachineFit fit;  ///< one linear block
};

/// An abrupt change of gain.
struct GainStep {
  double time_s = 0, change = 0;  ///< from the recording's start; of the gain, relative
};

/// A side channel, in its own unit.
struct SideOfMachine {
  std::string name;
  double mean = 0;
  double spread = 0;  ///< standard deviation over all recordings, > 0
};

/// What laws are started from: the linear machines and the ranges of the signals, all in scaled units.
struct MachineGround {
  std::vector<LinearMachine> linear;  ///< ascending in order
  /// Others of low order to start laws from: what integrates may do so, and what is late be late, for want of the law.
  std::vector<LinearMachine> beside;
  int chosen_order = 1;  ///< of the linear machine with the lowest held-out error
  int dead_samples = 0;
  int least_delay = 0;  ///< [samples] that a machine needs: one where a controller sets the input by the output
  double input_low = 0, input_high = 0, output_low = 0, output_high = 0;
  double input_zero = 0, output_zero = 0;  ///< zero of the recordings' own units
  double steepest_input_per_s = 0;
  std::vector<double> tones_hz;      ///< off the input's lines, strongest in the residual first
  std::vector<GainStep> gain_steps;  ///< of the output over the linear machine, most first
  std::vector<SideOfMachine> sides;  ///< those that move
  bool single_recording = true;
  bool one_rate = false;  ///< a sweep at one rate: dynamics cannot be told from memory, the core is static
  double longest_s = 0;

  double input_range() const { return input_high - input_low; }
  double output_range() const { return output_high - output_low; }
  const LinearMachine& of_order(int order) const;
};

/// One explanation: its causes by their contract names, and where its fit may begin.
struct MachineTrial {
  std::vector<std::string> causes;
  std::string place;  ///< "on the input", "between two linear blocks", ...
  std::vector<MachineFit> starts;
  std::vector<FreeParameter> last;  ///< freed once the others have their best: sooner they lead astray
};

/// A law on a signal that can be set into any chain: what a pair's second member must be.
struct SignalLaw {
  std::string cause;
  std::string place;
  bool on_input = false;
  struct Start {
    std::vector<MachineBlock> blocks;
    std::vector<FreeParameter> free;  ///< block counted from the first of `blocks`
  };
  std::vector<Start> starts;
};

/// Laws on the input or the output that the ranges allow.
std::vector<SignalLaw> signal_laws(const MachineGround& ground);

/// `law` set into a fitted chain, in front or at the end.
MachineFit with_law(const MachineFit& fit, const SignalLaw& law, const SignalLaw::Start& start);

/// Every single explanation: laws on input and output around each order of linear machine, laws between two linear
/// blocks, laws inside a motion, tanks.
std::vector<MachineTrial> single_trials(const MachineData& data, const MachineGround& ground);

/// ÿ = gain u + bias − damping ẏ − stiffness y − coulomb sign(ẏ) − cubic y³ − loop h(y), or the same of the speed
/// alone, in scaled units and seconds.
struct MotionEquation {
  double gain = 0, damping = 0, bias = 0, stiffness = 0, coulomb = 0, cubic = 0, loop = 0;
  double squares = 0;  ///< of what is left of ÿ
};
struct LoopShape {
  double beta = 0, delta = 0;
};
struct MotionTerms {
  bool stiffness = true, coulomb = false, cubic = false;
  bool shows_speed = false;
  std::optional<LoopShape> loop;  ///< h of MachineLaw::kRestoringLoop
};

/// The equation of a motion by least squares on smoothed derivatives: biased by noise, but where a free-run fit should
/// begin, whatever an identifier of linear machines made of it. The smoothing is a lag of so many samples, forwards and
/// backwards twice, the same for every term (the filter does not change a linear equation). Empty where the records
/// are too short for it.
std::optional<MotionEquation> motion_equation(const MachineData& data, const MotionTerms& terms, double lag_samples);

/// Parts of single_trials.
std::vector<MachineTrial> sandwich_trials(const MachineGround& ground);
std::vector<MachineTrial> motion_trials(const MachineData& data, const MachineGround& ground);
std::vector<MachineTrial> tank_trials(const MachineData& data, const MachineGround& ground);
MachineTrial magnitude_trial(const MachineData& data, const MachineGround& ground);

/// Family and origin of a cause in the contract's table.
std::string family_of(const std::string& cause);
std::string origin_of(const std::string& cause);

}  // namespace valvetriage
