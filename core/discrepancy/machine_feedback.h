#pragma once

#include <span>

#include "core/recording/recording.h"

namespace valvetriage {

/// What a closed loop leaves in its recordings.
struct LoopSigns {
  /// See `output_followed`.
  bool input_follows_output = false;
  /// An integrating controller's law holds exactly between changes of its set-point: the input's second differences are
  /// Σ c_k Δy_{t−k}, k = 0 … 2, Σ c_k ≠ 0 on three quarters of the samples, and the past alone foretells them far
  /// worse. The inverse of a machine has Σ c_k = 0. Within one sample the output then cannot follow the input: a fit
  /// that may use the same sample finds the controller, run backwards.
  bool integrating_controller = false;

  /// Whether a controller sets the input: the recording shows the loop, not the machine alone.
  bool is_regulated() const { return input_follows_output || integrating_controller; }
};

/// Cost O(n) per recording
LoopSigns loop_signs(std::span<const Recording> recordings);

}  // namespace valvetriage
