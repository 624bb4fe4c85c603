#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "core/model/valve_dynamics.h"
#include "core/recording/intersample.h"

namespace valvetriage {

/// A mode behind a valve's map (mode.h) brought to a sampling period: exact for an IntervalSignal delayed by any
/// fraction of a sample.
///
///   ÿ = ω² (u(t − delay) − y) − 2 ζ ω ẏ,   ω divided by `fall_to_rise_ratio` while u < y
///
/// All time runs slower where it is to fall, as in an OrificeVolume, told once a sample.
class SampledMode {
 public:
  /// A state off the mode's rest at its first input: ẏ/ω and y, in the unit of y.
  using Start = std::array<double, 2>;
  /// Over which samples it was to fall; empty where that is no other than rising.
  using Way = std::vector<bool>;

  /// One sample in state space: x ← transition x + Σ gain[k] u_k, u = start and end of the interval whose tail is seen,
  /// then of the one whose head is. x is ẏ/ω of the rising mode and y.
  struct Step {
    std::array<std::array<double, 2>, 2> transition;
    std::array<std::array<double, 2>, 4> gain;
  };

  /// mode: of second order, with the delay. fall_to_rise_ratio > 0, sample_period_s > 0
  SampledMode(const ValveDynamics& mode, double fall_to_rise_ratio, double sample_period_s);

  /// Free run from a start at the first input, before which that is held. out: as many values as input.start
  Way run(const IntervalSignal& input, const Start& start, std::span<double> out) const;
  /// A small change of the input and of the start, on a way that stays as it is.
  void run_along(const Way& way, const IntervalSignal& change, const Start& start, std::span<double> out) const;

  std::size_t whole_delay() const { return whole_delay_; }
  const Step& step(bool falls) const { return steps_[falls]; }
  bool is_symmetric() const { return is_symmetric_; }

 private:
  template <typename Falls>
  void run(const IntervalSignal& input, const Start& start, std::span<double> out, const Falls& falls) const;

  std::array<Step, 2> steps_;  ///< rising, falling
  std::size_t whole_delay_ = 0;
  bool is_symmetric_ = true;
};

}  // namespace valvetriage
