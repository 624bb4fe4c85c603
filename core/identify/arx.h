#pragma once

#include <span>

#include "core/identify/output_error.h"

namespace valvetriage {

/// A batch equation-error fit.
struct ArxFit {
  OutputErrorStructure structure;
  RationalCoefficients coefficients;
  CoefficientErrors std_errors;  ///< under white equation error: what ARX assumes, and noisy outputs break
  double static_gain = 0;
  double noise_variance = 0;  ///< of the equation error
  std::size_t rows = 0;
  bool full_rank = true;
};

/// Batch ARX: y_t = Σ b_i u_{t−k−i} − Σ a_j y_{t−j} + offset_r + e_t by Householder QR, an offset for each recording.
/// Unbiased for white e only; output noise biases it.
///
/// recordings  one or more of one sample time; a row takes part where it and all its lags are valid
/// Errors      no_samples, too_few_samples, constant_input, sample_time_differs
/// Cost        2 n p²
Result<ArxFit> fit_arx(std::span<const Recording* const> recordings, const OutputErrorStructure& structure);

/// The structure is one that can be identified. Errors: bad_option by field.
Result<void> check_structure(const OutputErrorStructure& structure);

}  // namespace valvetriage
