#pragma once

#include <functional>
#include <span>
#include <vector>

#include "core/model/linear_filter.h"
#include "core/model/model.h"
#include "core/model/sampled_mode.h"

namespace valvetriage {

/// Where the memories of a run's laws begin, from −1 to 1 each; the state of one recording, not of the valve.
using LawMemories = std::vector<double>;

/// What acts on the signals of a free run beside the model's own blocks; nothing by default. Each changes its signal in
/// place and may be called several times, on the first samples only (an initial state is being found) or on all.
struct SignalLaws {
  LawMemories memories;  ///< as the model has them; found anew where measured outputs set the initial state
  /// the first intervals of the input behind the laws on it
  std::function<IntervalSignal(const LawMemories&, std::size_t intervals)> at_input;
  /// behind G, before the map
  std::function<void(const LawMemories&, std::span<double> position)> at_position;
  std::function<void(std::span<double> steady)> at_steady;  ///< behind the map, before the volume
  /// behind everything; `steady` is what entered the volume, at the samples
  std::function<void(std::span<const double> steady, std::span<double> output)> at_output;
};

/// How often a model's blocks ahead of its volume, and the laws there, are run in a sample: the volume wants to know
/// the steady pressure half-way between samples as well.
inline std::size_t runs_per_sample(const Model& model) {
  return model.volume ? 2 : 1;
}

/// The input as those blocks and laws see it: `runs_per_sample` intervals a sample.
IntervalSignal inner_intervals(const Model& model, const IntervalSignal& input);

/// `simulate` with laws between the blocks, on the input's `inner_intervals`. A volume that settles elsewhere than at
/// its m starts where it settles.
Result<std::vector<double>> free_run(const Model& model, const SignalLaws& laws, const IntervalSignal& inner_input,
                                     double sample_period_s, std::span<const double> measured,
                                     const InitialState& initial, Horizon horizon);

/// A model's linear dynamics in their places, as they are run.
struct RunDynamics {
  LinearFilter ahead;                  ///< of the map: G, or 1 where a prompt spool is not slowed
  std::optional<SampledMode> behind;   ///< the map: the mode, delayed
  std::optional<ValveDynamics> spool;  ///< what `ahead` is where it is a spool
};

/// At the period of the inner intervals: a z-domain recursion where it fits the period, else sampled exactly.
/// Errors  as `simulate` for a sample time that the system cannot be brought to
Result<RunDynamics> run_dynamics(const Model& model, double inner_period_s);

/// Whether two sampling periods are one: their clocks differ by less than a crystal's 100 ppm.
bool is_same_period(double one_s, double other_s);

/// The measured outputs that set the initial state, NaN where one takes no part.
std::vector<double> first_outputs(const Recording& recording, const InitialState& initial);

/// What drives a model in a recording: a valve's memories the input without its measurement noise, a linear model the
/// input as it was logged.
IntervalSignal model_input(const Model& model, const Recording& recording);

}  // namespace valvetriage
