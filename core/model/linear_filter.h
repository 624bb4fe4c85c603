#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/model/state_space.h"
#include "core/model/transfer_function.h"

namespace valvetriage {

/// What a filter remembers between two runs.
///
/// x     states, order of the filter
/// past  the constant input before the first sample: what the delay line holds at the start. A run that goes on where
///       another ended is hence exact only without delay
struct FilterState {
  std::vector<double> x;
  double past = 0;
};

/// A linear system run over arrays: free-run simulation and its sensitivities.
///
/// Simulated in chain form (state_space.h), so that it is sound at order 9 with poles that cluster near z = 1, where a
/// difference equation with expanded polynomials is not. Immutable; one object serves any number of threads.
class LinearFilter {
 public:
  /// The recursion of a z-domain system on the samples as they stand.
  /// Errors  as cascade; `fractional_delay` where the delay is not a whole number of samples
  static Result<LinearFilter> recursion(const TransferFunction& discrete);

  /// A continuous system sampled exactly; its input goes between samples as `run` is told. Any delay.
  /// Errors  as sample
  static Result<LinearFilter> sampled(const TransferFunction& continuous, double sample_time_s);

  std::size_t order() const { return chain_.diagonal.size(); }
  int delay_samples() const { return delay_samples_; }
  const ChainForm& chain() const { return chain_; }

  /// At rest: zero state, zero input before.
  FilterState rest() const;
  /// Equilibrium at a constant input; none where a pole at z = 1 makes it infinite.
  std::optional<FilterState> steady(double input) const;

  /// Output of each sample, from `state`, which ends as the state after the last sample.
  ///
  /// input    n samples
  /// end      where the input arrives before the next sample, as IntervalSignal::end: end[i] = input[i] is held,
  ///          end[i] = input[i + 1] linear. A recursion does not read it. From `past` to the first sample is a hold.
  /// output   n samples, not overlapping the input
  /// Cost     O(n · order), nothing allocated per sample
  void run(FilterState& state, std::span<const double> input, std::span<const double> end,
           std::span<double> output) const;

 private:
  LinearFilter(ChainForm chain, int delay_samples);

  ChainForm chain_;
  int delay_samples_ = 0;
  std::vector<double> input_;   ///< chain_.input, row by row
  std::vector<double> direct_;  ///< chain_.direct
};

}  // namespace valvetriage
