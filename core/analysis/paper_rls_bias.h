#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "core/identify/rls.h"

namespace valvetriage {

/// A simulated valve on which the forms of RLS are compared: 1.4 to 1.6 A at 200 Hz, static gain 470 psi/A (a step of
/// 94 psi), second order, white noise of 0.35 psi rms.
struct RlsBiasScene {
  double natural_frequency_rad_s = 25;
  double damping_ratio = 1;
  double static_gain = 470;  ///< [psi/A]
  double noise_psi = 0.35;   ///< rms
  double sample_rate_hz = 200;
  double duration_s = 5;
  double step_at_s = 1;
};

/// What one form of RLS makes of one recording.
struct RlsOutcome {
  RlsForm form = RlsForm::kIncremental;
  std::uint64_t seed = 0;
  bool stable = false;
  double static_gain = 0;    ///< [psi/A]
  double free_run_rmse = 0;  ///< [psi], against the measurement; over this record alone where not stable
  double error_eq20 = 0;     ///< of that free run, rate and duration of the scene from the step on [psi/s]
  std::vector<double> a, b;
};

/// The difference equation that the scene's valve obeys without noise.
RationalCoefficients true_coefficients(const RlsBiasScene& scene);

/// Every form on the same recordings: second order, no forgetting, the true delay. Seeds are fixed.
std::vector<RlsOutcome> compare_rls_forms(const RlsBiasScene& scene, std::span<const std::uint64_t> seeds);

/// Eq 20 of a slower ("returned") valve under both readings of X_S. [psi/s]
struct SimulatedDataReadings {
  double own_model = 0;   ///< X_S from the valve's own model, fitted without error: noise alone
  double good_model = 0;  ///< X_S from the good valve's model
};
SimulatedDataReadings compare_simulated_data_readings(const RlsBiasScene& good, double slower_by, std::uint64_t seed);

}  // namespace valvetriage
