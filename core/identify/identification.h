#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/identify/order.h"
#include "core/identify/output_error.h"
#include "core/identify/rls.h"

namespace valvetriage {

enum class IdentificationMethod : std::uint8_t { kRls, kArx, kOutputError };
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

/// What `identify` finds out.
struct Identification {
  IdentificationMethod method = IdentificationMethod::kOutputError;
  OutputErrorStructure structure;
  TransferFunction transfer_function;
  RationalCoefficients coefficients;
  CoefficientErrors std_errors;
  double static_gain = 0;
  bool stable = false;
  std::optional<FreeRun> run;       ///< empty where the model is unstable
  std::optional<StepMetrics> step;  ///< empty where there is no settled step response
  std::string input_unit, output_unit;
  std::vector<TriedStructure> tried;
  std::string order_reason;  ///< why this order
  std::string termination;   ///< of the numerics
  std::vector<std::string> notes;

  double output_offset() const;  ///< mean over the recordings
};

/// Identifies a linear model of recordings that share their dynamics.
///
/// rls  the recursion over one recording after the other;  arx  batch equation error;  oe  free-run refinement.
/// Where order, zeros or delay are not given they are chosen by held-out free-run error, for every method alike.
///
/// Errors  as fit_output_error, fit_arx and RecursiveLeastSquares
Result<Identification> identify(std::span<const Recording* const> recordings, const IdentifyOptions& options);

/// As an affine Model: dynamics around the operating point.
Model to_model(const Identification& identification);

}  // namespace valvetriage
