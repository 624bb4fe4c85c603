#pragma once

#include <Eigen/Dense>

#include "tests/second_stand/session.h"

namespace valvetriage::second_stand {

/// How plainly an effect shows beside what good valves differ in:
///
///   d² = sᵀ (σ² I + J Jᵀ)⁻¹ s
///
/// s      noise-free output with the effect less that without, same valve and day, all recordings
/// σ      rms of the noise, taken as white
/// J      what one standard deviation of each latent of a unit does, by differences at the nominal unit
///
/// So it is a distance for detection by someone who knows valves and spread perfectly. There is no counterpart for
/// naming here, and neither colour of noise nor leftover bias of a simulation is in it.
class Distance {
 public:
  /// For sessions of these tests. Plays the session once per latent.
  explicit Distance(const std::vector<std::string>& tests);

  /// d, and the same without J: signal to noise.
  struct Figures {
    double d = 0, signal_to_noise = 0;
  };
  Figures measure(const Order& order) const;

 private:
  Eigen::MatrixXd spread_;                     ///< J
  Eigen::LLT<Eigen::MatrixXd> spread_factor_;  ///< of σ² I + Jᵀ J
};

}  // namespace valvetriage::second_stand
