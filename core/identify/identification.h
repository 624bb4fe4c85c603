#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/identify/order.h"
#include "core/identify/output_error.h"
#include "core/identify/response_order.h"
#include "core/identify/rls.h"

namespace valvetriage {

enum class IdentificationMethod : std::uint8_t { kRls, kArx, kOutputError, kAsymptotic, kRational };
std::string to_string(IdentificationMethod method);

struct IdentifyOptions {
  IdentificationMethod method = IdentificationMethod::kOutputError;
  std::optional<int> order{};  ///< number of poles; chosen where absent
  std::optional<int> zeros{};  ///< chosen where absent
  std::optional<int> delay_samples{};
  int largest_order = 8;
  OffsetSharing offsets = OffsetSharing::kPerRecording;
  RlsForm rls_form = RlsForm::kIncremental;
  double lambda = 1;
};

/// What the methods of the frequency domain have beyond the others.
struct FrequencyIdentification {
  FrequencyResponse response;
  ResponseModel model;
  std::vector<TriedResponseOrder> tried;
};

/// What `identify` finds out. The methods of the frequency domain give a transfer function in s, the others one in z.
struct Identification {
  IdentificationMethod method = IdentificationMethod::kOutputError;
  OutputErrorStructure structure;
  TransferFunction transfer_function;
  RationalCoefficients coefficients;  ///< of the difference equation; of its equivalent for a transfer function in s
  CoefficientErrors std_errors;       ///< a and b empty for a transfer function in s: see `frequency`
  double static_gain = 0;
  bool stable = false;
  std::optional<FreeRun> run;       ///< empty where the model is unstable
  std::optional<StepMetrics> step;  ///< empty where there is no settled step response
  std::string input_unit, output_unit;
  std::vector<TriedStructure> tried;
  std::string order_reason;  ///< why this order
  std::string termination;   ///< of the numerics
  std::vector<std::string> notes;
  std::optional<FrequencyIdentification> frequency;  ///< asymptotic, rational

  double output_offset() const;  ///< mean over the recordings
};

/// Identifies a linear model of recordings that share their dynamics.
///
/// rls  the recursion over one recording after the other;  arx  batch equation error;  oe  free-run refinement.
/// Where order, zeros or delay are not given they are chosen by held-out free-run error, for these alike.
///
/// asymptotic, rational  the recordings' frequency response, and a transfer function of it; order and zeros by held-out
/// frequencies. The free run is of its hold equivalent at the sampling rate.
///
/// Errors  as fit_output_error, fit_arx, RecursiveLeastSquares, estimate_frequency_response and choose_response_order
Result<Identification> identify(std::span<const Recording* const> recordings, const IdentifyOptions& options);

/// A transfer function in s run freely over recordings: its hold equivalent at their rate, initial states and offsets
/// by least squares.
///
/// Errors  as discretise_zoh and free_run
Result<FreeRun> free_run_of_response(std::span<const Recording* const> recordings, const TransferFunction& continuous,
                                     Hold hold);

/// As an affine Model: dynamics around the operating point.
Model to_model(const Identification& identification);

}  // namespace valvetriage
